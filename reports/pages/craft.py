"""The page of a craft over all its flights: what it is now, what changed, and each parameter with its band."""

from __future__ import annotations

from collections.abc import Sequence

from core.quantity import counted, uncertain
from pipeline.results.drift import CraftNote, CraftReview
from reports.figures.fleet import drift_figures
from reports.pages import html
from reports.views import log_words
from reports.views.drift import change_table, drift_sentences, drift_table


def craft_page(review: CraftReview, name: str, notes: Sequence[CraftNote] = ()) -> str:
    """Render the page."""
    whole = review.whole or review.drift
    courses, folded = drift_figures(whole, "craft-", notes)
    boundary = review.boundary
    return html.render(
        "craft.html",
        [*courses, *folded],
        title=name,
        facts=_facts(review),
        findings=() if review.drift is None else review.drift.findings,
        sentences=[
            *(log_words.sentence(sentence) for sentence in _changed(review)),
            *(s for s in drift_sentences(review.drift) if s not in _reasons(review)),
        ],
        remarks=[log_words.sentence(remark) for remark in review.remarks],
        notes=[
            (f"{note.at:%Y-%m-%d %H:%M} UTC", note.text, "flights before it are not pooled" if note.boundary else "")
            for note in sorted(notes, key=lambda note: note.at, reverse=True)
        ],
        since=change_table(review.since) if review.since else None,
        since_title="" if boundary is None else f"Since {boundary.at:%Y-%m-%d}: {boundary.text}",
        courses=courses,
        drift=drift_table(review.drift),
        folded=folded,
        autopilot=review.autopilot.table() if review.autopilot and review.autopilot.values else None,
    )


def _facts(review: CraftReview) -> str:
    text = counted(len(review.flights), "flight")
    if review.pooled != review.flights:
        text += f", of which {len(review.pooled)} are pooled"
        if review.boundary is not None:
            text += f": those since {review.boundary.at:%Y-%m-%d} ({review.boundary.text})"
    return text


def _reasons(review: CraftReview) -> set[str]:
    findings = () if review.drift is None else review.drift.findings
    return {log_words.sentence(finding.reason) for finding in findings}


def _changed(review: CraftReview) -> list[str]:
    """Report what changed with the last boundary."""
    if review.boundary is None or not review.since:
        return []
    changed = [
        f"{each.parameter} went from {uncertain(each.a.value, each.a.sigma)} to "
        f"{uncertain(each.b.value, each.b.sigma)} {each.unit.partition(',')[0]}".rstrip()
        for each in review.since
        if each.significant
    ]
    since = f"since {review.boundary.text} ({review.boundary.at:%Y-%m-%d})"
    if not changed:
        return [f"{since}, none of the {len(review.since)} parameters known on both sides is seen to differ"]
    return [f"{since}, {each}" for each in changed]
