"""The laboratory: experiments whose truth is known, written where no estimator looks."""
