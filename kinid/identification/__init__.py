"""One identification problem for fits, comparisons, diagnoses and plans: residual, error model, solver, covariance."""
