// The tools, in the order of their tabs. Each has what its panel says, as HTML, and what it adds to
// the map and to the panel at a moment. `scene` is what the session sent, `stage` shows it.

import { CHANNEL_TOOL } from "./channel.js";
import { COMPARE } from "./compare.js";
import { FLY } from "./fly.js";
import { PAINT } from "./paint.js";
import { THINK } from "./think.js";
import { TRAIN } from "./train.js";

export const TOOLS = {
  fly: FLY,
  compare: COMPARE,
  think: THINK,
  channel: CHANNEL_TOOL,
  paint: PAINT,
  train: TRAIN,
};
