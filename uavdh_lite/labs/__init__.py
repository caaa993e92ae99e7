"""Interactive labs for notebooks and the web page: thin views over the library."""

from uavdh_lite.labs.channel import ChannelLab
from uavdh_lite.labs.city import CityLab
from uavdh_lite.labs.fly import FlyLab
from uavdh_lite.labs.gallery import Labs
from uavdh_lite.labs.mission import MissionLab
from uavdh_lite.labs.think import ThinkLab
from uavdh_lite.labs.training import TrainingLab

__all__ = ["ChannelLab", "CityLab", "FlyLab", "Labs", "MissionLab", "ThinkLab", "TrainingLab"]
