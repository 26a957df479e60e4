"""Scene test: can a classifier tell sampled traffic scenes from recorded ones?"""

from scene_test.classifier import SceneTest, Surroundings, scene_test
from scene_test.features import FEATURES, Road, Vehicles, vehicle_features
from scene_test.tables import compare_folders, read_folder

__all__ = [
    "FEATURES",
    "Road",
    "SceneTest",
    "Surroundings",
    "Vehicles",
    "compare_folders",
    "read_folder",
    "scene_test",
    "vehicle_features",
]
