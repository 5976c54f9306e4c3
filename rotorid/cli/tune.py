"""``rotorid tune``: gains that the flown logs support, or why none."""

from pathlib import Path
from typing import Annotated

import typer

from rotorid.cli.exits import OK, SOME_FAILED
from rotorid.cli.options import existing_log, open_log


def tune(
    logs: Annotated[
        list[Path],
        typer.Argument(
            callback=existing_log, help="Flights of one craft with chirps of mode SYSTEMID; LOG#2 is the second of LOG."
        ),
    ],
    aim: Annotated[
        str, typer.Option(help="rejection (of disturbances), quiet (actuators), or margins (wide).")
    ] = "rejection",
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for proposed.param, rollback.param, tuning.json and tuning.html; none without."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Write tuning.json to stdout instead of sentences.")] = False,
) -> None:
    """Propose gains of the rate controllers for the worst case of what the flights leave possible, or refuse.

    The gains keep 6 dB, 45 deg and a peak of 6 dB, and change by a factor of two at most. Without the evidence there
    is a reason, what to fly instead, and no number; the exit status is then 1.

    Example: rotorid tune FLIGHT.bin --out tuning
    """
    from core.serialization import as_json as strict_json
    from reports.numbers.loops import tuning_report
    from reports.pages.loops import loops_page
    from rotorid.cli.output import prepare
    from sysid.loops.tuning import tune as propose

    if out is not None:
        prepare(out)
    result = propose([open_log(log) for log in logs], aim)
    text = strict_json(tuning_report(result))
    if out is not None:
        (out / "tuning.json").write_text(text, encoding="utf-8")
        (out / "tuning.html").write_text(loops_page(result), encoding="utf-8")
        for name, write in (("proposed.param", result.proposed_file), ("rollback.param", result.rollback_file)):
            if result.refused is None:
                (out / name).write_text(write(), encoding="utf-8")
            else:
                # What an earlier run proposed must not be taken for this one's.
                (out / name).unlink(missing_ok=True)
    if as_json:
        typer.echo(text, nl=False)
    elif result.refused is not None:
        typer.echo(f"nothing is proposed: {result.refused}")
    else:
        for name, value in sorted(result.proposed.items()):
            typer.echo(f"{name:<20} {result.rollback[name]:>12.6g} -> {value:.6g}")
        for axis in result.axes:
            if axis.tuned is None:
                typer.echo(f"{axis.axis}: unchanged: {axis.refused}")
                continue
            bounds = axis.worst
            typer.echo(
                f"{axis.axis}: at the worst gain margin {bounds['gain_db']:.1f} dB, phase margin "
                f"{bounds['phase_deg']:.0f} deg, peak {bounds['peak_db']:.1f} dB; rejects up to "
                f"{bounds['rejection_hz']:.1f} Hz"
            )
        for remark in result.remarks:
            typer.echo(remark)
    if out is not None and not as_json:
        typer.echo(out / "tuning.html")
    raise typer.Exit(OK if result.refused is None else SOME_FAILED)
