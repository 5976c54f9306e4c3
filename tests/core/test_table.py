"""One table reads the same on a page, as Markdown and in a terminal, whatever its texts hold."""

import pandas as pd
from rich.console import Console

from core.table import Cell, Row, Table

TABLE = Table("model", ["error (m)", "use"], [Row("a|b", ["0.120", Cell("[yes]", "good")])], texts=[1])


def shown(table: Table, width: int = 60) -> str:
    console = Console(width=width, highlight=False, color_system=None)
    with console.capture() as capture:
        console.print(table.terminal())
    return capture.get()


def test_text_is_text_everywhere():
    assert TABLE.markdown().splitlines()[1:] == ["| --- | ---: | --- |", r"| a\|b | 0.120 | \[yes\] |"]
    assert "<td style='text-align:left'>[yes]</td>" in TABLE.html()
    assert "[yes]" in shown(TABLE)


def test_a_narrow_terminal_folds_text_and_no_number():
    long = Table("name", ["rate (Hz)", "columns"], [Row("imu", ["25.125", "gyro_x gyro_y gyro_z accel_x"])], texts=[1])
    assert "25.125" in shown(long, 32)
    assert "accel_x" in " ".join(shown(long, 32).split())


def test_a_frame_shows_numbers_with_five_digits_and_texts_as_they_are():
    table = Table.from_frame(pd.DataFrame({"case": ["<1>"], "pwm": [1523.456789], "word": ["yes"]}), "What flew.")
    assert table.rows[0] == Row("<1>", ["1523.5", "yes"])
    assert list(table.texts) == [1]
    assert "&lt;1&gt;" in table.html()
