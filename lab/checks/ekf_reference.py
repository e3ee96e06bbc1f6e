"""A right answer to every question of notebook 06, under its name in the table, for `lab.checks.reference`."""

from lab.checks import ekf_recipes
from lab.checks.ekf_recipes import ekf_invert, ekf_move, ekf_observe

ekf_predict = ekf_recipes.predict_with()
ekf_correct = ekf_recipes.correct_with()
ekf_initialise = ekf_recipes.initialise_with()
pose_nees = ekf_recipes.nees_with()
frame_directions = ekf_recipes.directions_with()
ray_to_point = ekf_recipes.ray_with()

__all__ = [
    "ekf_correct",
    "ekf_initialise",
    "ekf_invert",
    "ekf_move",
    "ekf_observe",
    "ekf_predict",
    "frame_directions",
    "pose_nees",
    "ray_to_point",
]
