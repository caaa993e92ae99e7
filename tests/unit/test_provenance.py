import os
import platform

import numpy as np
import torch

import uavdh_lite
from uavdh_lite.provenance import provenance


def test_versions_are_those_in_use_and_the_machine_is_this_one():
    found = provenance()
    assert found["version"] == uavdh_lite.__version__ and found["numpy"] == np.__version__
    assert torch.__version__.startswith(found["torch"])  # which build may be added to it
    assert found["python"] == platform.python_version()
    assert found["machine"].startswith(f"{os.cpu_count()}-core")
