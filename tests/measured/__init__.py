"""Logs of real machines as a suite for the diagnosis: effects injected into measured samples, and transfer between
logs.

    python -m measured.study OUT.json --engine diagnosis --sizes 2,5        from the folder of the tests

What is injected is done to the measured readings by formulas of this folder (numpy, scipy, and Pinocchio for weights of
bodies); no code of the catalogue takes part. How much: so that what the starting model's linear refit can't take up of
it is 1, 2 or 5 times the held-out error that the starting model leaves, in the channels that the effect is about.
What the log holds by itself is not false: an added name counts as not there where it was not added without the
injection.
"""
