"""Transfer functions from sampled data: prediction-error method, SRIVC, closed loop, ARX."""
