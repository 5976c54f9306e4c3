"""Several models on the same held-out records, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from core.quantity import number
from core.summary import Summarised
from core.table import Row, Table
from sysid.records.experiment import Experiment
from sysid.validation.assessment import HORIZONS, Predictor, Validation
from sysid.validation.assessment import validate as validate_model


class WholeTable(pd.DataFrame):
    """A table that prints every column: pandas leaves out those in the middle where a line has 80 characters."""

    def __repr__(self) -> str:
        """Return all of it."""
        return self.to_string()


@dataclass(frozen=True, slots=True, repr=False)
class Comparison(Summarised):
    """What several models are worth on the same records."""

    validations: tuple[Validation, ...]  #: One for each model, in the order given.

    @property
    def table(self) -> pd.DataFrame:
        """RMSE of the free run by model and output, averaged over the held-out flights, beside the best baseline."""
        rows = []
        for validation in self.validations:
            held_out = validation.table[~validation.table["trained"]] if validation.unseen else validation.table
            for output, rmse in validation.average.items():
                baselines = held_out[held_out["output"] == output][_BASELINES].mean()
                rows.append(
                    {
                        "model": validation.model,
                        "output": output,
                        "rmse": rmse,
                        "best_baseline": float(baselines.min()),
                        "trusted": output in validation.uses.free_run.follows,
                    }
                )
        return WholeTable(pd.DataFrame(rows).set_index(["model", "output"]))

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            validation.model: ", ".join(f"{output} {rmse:.3g}" for output, rmse in validation.average.items())
            + (
                " (RMSE on held-out flight)"
                if validation.unseen
                else " (RMSE on the training flight: nothing is held out)"
            )
            for validation in self.validations
        }

    def _repr_html_(self) -> str:
        rows = [
            Row(
                row["model"],
                [row["output"], number(row["rmse"]), number(row["best_baseline"]), "yes" if row["trusted"] else "no"],
            )
            for row in self.table.reset_index().to_dict("records")
        ]
        return Table("model", ["output", "RMSE", "best of the baselines", "trusted"], rows).html()


_BASELINES = ["rmse_mean", "rmse_constant_position", "rmse_constant_velocity"]


def validate(
    models: Predictor | Sequence[Predictor],
    experiments: Experiment | Sequence[Experiment],
    horizons: Sequence[float] = HORIZONS,
) -> Comparison:
    """Validate models on records, held-out ones above all.

    Parameters
    ----------
    models : Predictor or sequence of Predictor
        Anything that offers ``simulate(experiment)``, ``predict(experiment, horizon)`` and ``training``.
    experiments : Experiment or sequence of Experiment
        Which of them a model was fitted to is known from their names.
    horizons : sequence of float
        Seconds ahead.

    Returns
    -------
    Comparison
    """
    several = models if isinstance(models, Sequence) else (models,)
    return Comparison(tuple(validate_model(model, experiments, horizons) for model in several))
