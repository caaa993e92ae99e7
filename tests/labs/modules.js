// All modules of the session and of a run, for `modules` in conftest.py.

import { Run } from "../../uavdh_lite/labs/run.js";
import { Session } from "../../uavdh_lite/labs/session.js";
