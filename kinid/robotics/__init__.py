"""The robot: kinematics, the estimate of its motion, the wrench at its sensor, joint torques, and the surface that it
touches.
"""
