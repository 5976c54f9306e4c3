"""Settings that cannot be are refused with what they may be."""

import pytest
from typer.main import get_command

from api.store.resources import Configuration
from pipeline import AnalysisConfig, ConfigError
from pipeline.config import SETTINGS
from rotorid.cli.main import app


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("rate", 0.0),
        ("rate", float("nan")),
        ("poles", 0),
        ("poles", 13),
        ("zeros", 5),
        ("zeros", -1),
        ("mass", 0.0),
        ("training_fraction", 1.0),
        ("time_limit", 0.0),
    ],
)
def test_impossible_settings_name_themselves(setting, value):
    with pytest.raises(ConfigError, match=setting):
        AnalysisConfig(**{setting: value})


def test_python_command_line_and_service_say_the_same_of_a_setting():
    (analyze,) = (each for each in get_command(app).commands.items() if each[0] == "analyze")
    options = {each.name: each for each in analyze[1].params}
    offered = Configuration.model_fields
    for name, setting in SETTINGS.items():
        assert options[name].help.startswith(setting.help), name
        assert options[name].default == (getattr(AnalysisConfig(), name) or options[name].default), name
        if name in offered:
            assert offered[name].description == setting.help
    assert set(offered) < set(SETTINGS) < set(AnalysisConfig.__dataclass_fields__)
