"""What a log itself says about its sensors: lags and noise settings by maximum likelihood of the innovations.

Nothing here looks at truth or at the autopilot's estimate. Each setting climbs a ladder of values, one after the other,
by the log-likelihood that the filter reaches on a window of the flight. A lag other than the documented one must earn
it.
"""

from estimation.tuning.lags import DECISIVE, LAGGING
from estimation.tuning.search import RELINEARISED, WINDOW, Tuned, is_sought, relinearised, settled, tune, window

__all__ = [
    "DECISIVE",
    "LAGGING",
    "RELINEARISED",
    "WINDOW",
    "Tuned",
    "is_sought",
    "relinearised",
    "settled",
    "tune",
    "window",
]
