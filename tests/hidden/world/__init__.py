"""The simulator: paths, material, friction, arm, drives and sensors. It imports nothing of kinid but Log, Rig and
URDFs.
"""
