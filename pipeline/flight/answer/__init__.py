"""The first screen of a flight: one file for each of its six lines, and one for the plot beside them."""

from pipeline.flight.answer.composition import compose_answer

__all__ = ["compose_answer"]
