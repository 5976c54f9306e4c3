"""``rotorid prove``: what one flight foretold of the next, against what that measured."""

from pathlib import Path
from typing import Annotated

import typer

from rotorid.cli.exits import OK, SOME_FAILED
from rotorid.cli.options import existing_log, open_log


def prove(
    before: Annotated[
        Path, typer.Argument(callback=existing_log, help="Log of before the change of gains; LOG#2: its second flight.")
    ],
    after: Annotated[Path, typer.Argument(callback=existing_log, help="Log of after it, with chirps again.")],
    as_json: Annotated[bool, typer.Option("--json", help="Write the numbers as JSON to stdout.")] = False,
) -> None:
    """Compare predicted with measured margins, bandwidth and responses after a change of gains.

    Margins that are thin after the change come first. The verdict is "as predicted", "better", or "worse: restore
    rollback.param"; the exit status is 1 for the last, for thin margins, and where the logs cannot be compared.

    Example: rotorid prove before.bin after.bin
    """
    from core.quantity import uncertain
    from core.serialization import as_json as strict_json
    from reports.numbers.loops import proof_report
    from sysid.loops.proof import WANTED, WORSE
    from sysid.loops.proof import prove as compare

    proof = compare(open_log(before), open_log(after))
    if as_json:
        typer.echo(strict_json(proof_report(proof)), nl=False)
    elif proof.refused is not None:
        typer.echo(f"not comparable: {proof.refused}")
    else:
        for axis, margins in proof.thin.items():
            typer.echo(f"THIN: {axis} has {margins}; rotorid tune asks for {WANTED}")
        for name, (old, new) in proof.changed.items():
            typer.echo(f"{name:<20} {old:>12.6g} -> {new:.6g}")
        if proof.beyond:
            typer.echo("changed beyond the loops: " + ", ".join(proof.beyond))
        typer.echo(f"{'':<8}{'':<24}{'predicted':>20}{'measured':>20}")
        for row in proof.table.reset_index().to_dict("records"):
            cells = [
                "beyond the band" if value != value else uncertain(value, None if sigma != sigma else sigma)
                for value, sigma in (
                    (row["predicted"], row["predicted_sigma"]),
                    (row["measured"], row["measured_sigma"]),
                )
            ]
            typer.echo(f"{row['axis']:<8}{row['quantity']:<24}{cells[0]:>20}{cells[1]:>20} {row['unit']}")
        for remark in proof.remarks:
            typer.echo(remark)
        typer.echo(proof.verdict)
    failed = proof.refused is not None or proof.verdict == WORSE or bool(proof.thin)
    raise typer.Exit(SOME_FAILED if failed else OK)
