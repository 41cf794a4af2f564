"""Prescribed-performance attitude control for ROS 2 (Lei, Meng, Wang, Yin and Jin, 2022)."""

__version__ = "0.1.0"
