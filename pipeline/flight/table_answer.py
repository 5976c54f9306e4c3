"""What tables of other origin say at first sight: how far ahead the model predicts, and what it knows of the craft."""

from __future__ import annotations

from collections.abc import Sequence

from core.quantity import counted
from logparse import Finding, Severity
from pipeline.results.answer import Answer, AnswerLine, Picture, Tone
from sysid.rigid_body.model_record import BodyParameter
from sysid.rigid_body.six_dof.model import SixDofModel
from sysid.validation.states import StateVerdict

#: What is asked of the craft, and the parameters that answer.
_ASKED = (
    ("Thrust", ("thrust",)),
    ("Turning", ("roll_gain", "pitch_gain")),
    ("Drag", ("drag_rotor_x", "drag_quadratic_x")),
)


def table_answer(verdicts: Sequence[StateVerdict], model: SixDofModel, findings: Sequence[Finding]) -> Answer:
    """Answer for each state, for what a craft is asked first, and for the tables themselves."""
    lines = [_ahead(verdict) for verdict in verdicts]
    lines += [
        _known(asked, [model.parameters[name] for name in names], bool(model.kinds.motors)) for asked, names in _ASKED
    ]
    return Answer(lines=(*lines, _checked(findings)), picture=Picture.PREDICTION)


def _ahead(verdict: StateVerdict) -> AnswerLine:
    purpose = f"Predict {verdict.state}"
    if verdict.horizon is None or verdict.model is None or verdict.simple is None:
        return AnswerLine(purpose=purpose, word="not judged", tone=Tone.UNKNOWN, text="the records are too short")
    text = f"{verdict.model:.2g} {verdict.unit}; without a model {verdict.simple:.2g}"
    if not verdict.useful:
        return AnswerLine(purpose=purpose, word="no", tone=Tone.BAD, text=f"{verdict.horizon:g} s ahead {text}")
    return AnswerLine(purpose=purpose, word=f"{verdict.horizon:g} s ahead", tone=Tone.GOOD, text=text)


def _known(asked: str, parameters: Sequence[BodyParameter], motors: bool) -> AnswerLine:
    """Answer with the first parameter that is determined, in SI where it is known; `motors` are single ones."""
    for each in parameters:
        for value, sigma, unit in ((each.si_value, each.si_sigma, each.si_unit), (each.value, each.sigma, each.unit)):
            if value is not None and sigma is not None:
                bare, _, condition = unit.replace("^2", "²").partition(" at ")
                # Motion alone knows forces by the mass only, and turning by the inertia: accelerations.
                mass = "over mass, " if each.name not in ("roll_gain", "pitch_gain") and bare[0] != "N" else ""
                text = f"{mass}{_spoken(each.name, motors)} {f'at {condition}' if condition else ''}".strip()
                return AnswerLine(
                    purpose=asked, word="known", tone=Tone.GOOD, text=text, value=value, sigma=sigma, unit=bare
                )
    return AnswerLine(purpose=asked, word="not determined", tone=Tone.UNKNOWN, text=parameters[0].reason)


def _spoken(name: str, motors: bool) -> str:
    """Name a parameter beside its number."""
    if name == "thrust":
        return "of each rotor" if motors else "in all"
    return {"roll_gain": "in roll", "pitch_gain": "in pitch"}.get(name, "forward")


def _checked(findings: Sequence[Finding]) -> AnswerLine:
    grave = [finding for finding in findings if finding.severity is not Severity.INFO]
    if not grave:
        return AnswerLine(purpose="Tables", word="consistent", tone=Tone.GOOD, text="no column contradicts another")
    errors = any(finding.severity is Severity.ERROR for finding in grave)
    tone = Tone.BAD if errors else Tone.CARE
    text = f"{counted(len(grave), 'finding')} below, first: {grave[0].reason}"
    return AnswerLine(purpose="Tables", word="see findings", tone=tone, text=text)
