"""Statistics of estimates: covariance under coloured residuals, residual tests, numbers with their sigma."""
