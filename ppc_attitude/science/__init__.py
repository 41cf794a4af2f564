"""The science: NumPy and Numba only, no ROS, no clock. Reads like the paper's block diagram."""
