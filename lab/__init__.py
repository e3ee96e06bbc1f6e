"""A toy SLAM laboratory in which every particle filter is measured against the exact Kalman filter.

The map of the house, floor by floor, is in the README; nothing is imported here, so that ``import lab`` costs nothing.
"""

__version__ = "0.1.0"
