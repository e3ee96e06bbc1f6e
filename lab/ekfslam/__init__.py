"""EKF-SLAM after Joan Solà's guide: the second wing of the laboratory, in Solà's own symbols.

    m = Map("fej")                                            # "ekf", "fej" or "ri": the one switch
    robot = m.add_robot(pose, P, sensors=[sensor], Q=Q)       # P = 0 unless given
    m.move(robot, u, Q)                                       # u = [dx, da] or [dx, dy, da]
    landmark = m.initialise(robot, sensor, y, name)           # point, or inverse depth for a bearing
    observation = m.observe(robot, sensor, landmark, y)       # z, Z, nis, dof; target may be another robot
    if compatible(observation): m.correct(observation)        # or m.correct(o1, o2, ...): one joint update
    m.delete(landmark)
    m.pose(robot), m.point(landmark), m.points()              # mean and covariance in ordinary coordinates

Models are in `frames`, `motion`, `sensor` and `inverse_depth`, each value followed by its Jacobians; the guide's loop
is in `slam`, its cloister in `world`.  A sister of lab.solvers: the two never meet.
Source: J. Solà, Simultaneous localization and mapping with the extended Kalman filter (2014).
"""

from lab.ekfslam.association import compatible
from lab.ekfslam.entities import Landmark, Observation, Robot
from lab.ekfslam.filters import FILTERS
from lab.ekfslam.map import Map
from lab.ekfslam.sensor import PRESETS, Sensor

__all__ = ["FILTERS", "PRESETS", "Landmark", "Map", "Observation", "Robot", "Sensor", "compatible"]
