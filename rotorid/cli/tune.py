"""``rotorid frequency``, ``tune``, ``prove`` and ``design``: the loops of a craft, and what to fly next."""

from pathlib import Path
from typing import Annotated

import typer

from rotorid.cli.options import existing_log, folder_of, open_log, open_power_ups, parted
from rotorid.cli.output import NOT_POSSIBLE, OK, SOME_FAILED, console, prepare


def frequency(
    logs: Annotated[
        list[Path],
        typer.Argument(callback=existing_log, help="Flights of one craft at one tuning, summed; LOG#2: LOG's second."),
    ],
    axis: Annotated[
        list[str] | None, typer.Option(help="roll, pitch, yaw or vertical; may be repeated. Default: all.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for frequency.html, .json, .mat and frequency_AXIS.csv. Default: out/NAME."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Write frequency.json to stdout, no table.")] = False,
) -> None:
    """Estimate frequency responses from chirps or ordinary flights, and fit the dynamics of every axis to them.

    Example: rotorid frequency chirps.bin sticks.bin --axis roll --out frequency
    """
    from pipeline.config import ConfigError
    from pipeline.execution.progress import shown
    from pipeline.flight.rotation import turning_of
    from reports.pages.frequency import frequency_page
    from reports.views.rotation import parameter_table, sentences
    from sysid.frequency.axes import AXES
    from sysid.frequency.export import survey_json, write
    from sysid.frequency.survey import survey

    wanted = tuple(dict.fromkeys(axis)) if axis else tuple(AXES)
    unknown = [name for name in wanted if name not in AXES]
    if unknown:
        raise ConfigError(f"there is no axis {', '.join(unknown)}; the axes are {', '.join(AXES)}")
    out = out or folder_of(parted(logs[0])[0])
    prepare(out)
    with shown() as progress:
        progress("reading", 0.0)
        flights = [log for path in logs for log in open_power_ups(path)]
        progress("estimating", 0.3)
        surveyed = survey(flights, wanted)
    (out / "frequency.html").write_text(frequency_page(surveyed), encoding="utf-8")
    write(surveyed, out)
    axes = [turning_of(axis_survey) for axis_survey in surveyed.axes]
    if as_json:
        typer.echo(survey_json(surveyed), nl=False)
    else:
        console().print(parameter_table(axes, brief=True).terminal("Frequency responses", fold_labels=False))
        for axis_rotation in axes:
            for sentence in sentences(axis_rotation):
                typer.echo(sentence)
        for finding in surveyed.findings:
            typer.echo(f"{finding.severity}: {finding.reason} {finding.advice}")
        typer.echo(out / "frequency.html")
    if not any(axis_rotation.determined for axis_rotation in axes):
        raise typer.Exit(NOT_POSSIBLE)


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
    i_term: Annotated[
        float | None, typer.Option(help="I as a part of P. Default: what is best; where I flew at 0, 1 (yaw 0.1).")
    ] = None,
    size: Annotated[
        float | None,
        typer.Option(min=0.05, max=20.0, help="Distance of opposite hubs, m, to scale the criteria's limits to."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for proposed.param, rollback.param, tuning.json and tuning.html. Default: out/NAME."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Write tuning.json to stdout instead of sentences.")] = False,
) -> None:
    """Propose gains of the rate controllers for the worst case of what the flights leave possible, or refuse.

    The logs may hold the chirps of one axis each, with its I at 0, as ArduPilot's procedure flies them.

    The gains keep 6 dB, 45 deg and a peak of 6 dB; P and D change by a factor of two at most. Without the evidence
    there is a reason, what to fly instead, and no number; the exit status is then 3.

    Example: rotorid tune ROLL.bin PITCH.bin YAW.bin --out tuning
    """
    from core.serialization import as_json as strict_json
    from reports.pages.loops import loops_page
    from sysid.loops.report import tuning_report
    from sysid.loops.tuning import tune as propose

    out = out or folder_of(parted(logs[0])[0])
    prepare(out)
    result = propose([open_log(log) for log in logs], aim, i_term, size)
    report = tuning_report(result)
    text = strict_json(report)
    (out / "tuning.json").write_text(text, encoding="utf-8")
    (out / "tuning.html").write_text(loops_page(report), encoding="utf-8")
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
            before, flown = result.rollback[name], result.flown[name]
            during = "" if before == flown else f" ({flown:.6g} during the chirp)"
            typer.echo(f"{name:<20} {before:>12.6g} -> {value:.6g}{during}")
        for axis in result.axes:
            if axis.tuned is None:
                typer.echo(f"{axis.axis}: unchanged: {axis.reason}")
                continue
            missed = [f"{one.name} {one.value}" for one in axis.promises if one.kept is False]
            missed += ["the aim, of which this is a first step"] if axis.short else []
            typer.echo(f"{axis.axis}: {axis.promise}; misses {', '.join(missed) or 'no criterion of the sheet'}")
        for remark in result.remarks:
            typer.echo(remark)
    if not as_json:
        typer.echo(out / "tuning.html")
    raise typer.Exit(OK if result.refused is None else NOT_POSSIBLE)


#: What ``--json`` writes of a proof.
_WRITTEN = ("before", "after", "refused", "verdict", "changed", "beyond", "table", "remarks")


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
    from sysid.loops.proof import WANTED, WORSE
    from sysid.loops.proof import prove as compare

    proof = compare(open_log(before), open_log(after))
    if as_json:
        numbers = {name: getattr(proof, name) for name in _WRITTEN}
        typer.echo(strict_json({"kind": "proof"} | numbers), nl=False)
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


def design(
    log: Annotated[Path, typer.Argument(callback=existing_log, help="A log of the craft; LOG#2: its second flight.")],
    purpose: Annotated[str, typer.Option("--for", help="rates, drag, inertia, thrust or position.")] = "rates",
    out: Annotated[Path | None, typer.Option(help="Folder for the files. Default: out/NAME, of the log.")] = None,
    lean: Annotated[float, typer.Option(min=2.0, max=25.0, help="Largest lean, deg.")] = 20.0,
    height: Annotated[float, typer.Option(min=5.0, max=120.0, help="Height above ground, m.")] = 20.0,
) -> None:
    """Write what to fly next: SYSTEMID parameters, a mission or a Lua script, with the errors it will leave.

    Every file has its limits in it. For inertia the log needs chirps of mode SYSTEMID, however small;
    for rates a first chirp is chosen from the gains alone.

    Example: rotorid design FLIGHT.bin --for rates --out next
    """
    from sysid.loops.chirps import Limits
    from sysid.loops.design import design as plan

    result = plan(open_log(log), purpose, Limits(lean_deg=lean, height_m=height))
    if result.refused is not None:
        typer.echo(f"nothing is designed: {result.refused}")
        raise typer.Exit(NOT_POSSIBLE)
    out = out or folder_of(parted(log)[0])
    prepare(out)
    for item in result.expected:
        typer.echo(f"predicted standard deviation of {item}")
    for name, text in result.files.items():
        (out / name).write_text(text, encoding="utf-8")
        typer.echo(out / name)
    raise typer.Exit(OK)
