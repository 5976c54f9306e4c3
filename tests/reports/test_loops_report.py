"""A tuning's file and page, where nothing could be tuned: they say why, and what a log wrote stays text."""

from core.serialization import as_json, from_json
from reports.pages.loops import TuningReport, loops_page, tuning_report
from sysid.loops.safety import Aim
from sysid.loops.search import AxisTuning
from sysid.loops.tuning import Tuning


def test_a_refusal_is_written_and_escaped():
    tuning = Tuning(
        logs=("<b>.bin",),
        aim=Aim(),
        proposed={},
        rollback={},
        flown={},
        refused="no chirps </script>",
        axes=(AxisTuning("roll", "no chirps"),),
        remarks=(),
        made="2026-03-14",
    )
    written = tuning_report(tuning)
    report = from_json(as_json(written), TuningReport)
    assert report.axes[0].refused == "no chirps"
    assert report.axes[0].flown is None
    page = loops_page(written)
    assert "<h1>Loops of &lt;b&gt;.bin</h1>" in page
    assert "no chirps </script>" not in page
