"""Sound inputs of every kind, changed at random: each ends in success or in one clear refusal."""
