"""A model is an ordered set of effects; what drives it, and its way along the measurement chain."""
