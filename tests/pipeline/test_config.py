"""Settings that cannot be are refused with what they may be."""

import pytest

from logparse import RotoridError
from pipeline import AnalysisConfig, ConfigError


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


def test_config_errors_are_errors_a_user_can_act_on():
    assert issubclass(ConfigError, RotoridError)


def test_defaults_are_the_papers():
    config = AnalysisConfig()
    assert (config.rate, config.poles, config.zeros) == (10.0, 5, 3)
