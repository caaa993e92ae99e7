// Who flies, in JavaScript: what planners, observation, network, agent and checkpoint do in Python,
// and of beyond told, failsafe and global_local, by their names; tests/labs/test_world.py compares
// them. M is the number of cells on a side of the largest city that an agent sees, W = 2M − 1.

import {
  ACTIONS,
  CHANNEL,
  City,
  HOVER,
  InputError,
  Portable,
  Use,
  hasChannel,
  kept,
  require,
  safeActions,
} from "./world.js";

/** Every action equally likely. */
export class Random {
  constructor(seed = 0) {
    this.generator = new Portable(Use.EXPLORATION, seed);
  }

  act() {
    return this.generator.integers(0, ACTIONS.length);
  }
}

/** Fly to the nearest device with data left; turn back when the time just suffices to land. */
export class Greedy {
  /** @param {import("./world.js").Environment} environment */
  constructor(environment) {
    Object.assign(this, { environment, approaches: new Map() });
  }

  act(state) {
    const { environment } = this;
    const goal = this.goal(state);
    const home = environment.wayHome[state.uavCell];
    if (goal === null) return home;
    const action = this.towards(state.uavCell, goal);
    // What the action leads to must leave time to fly home and land.
    const after = environment.nextCell(state.uavCell, action);
    return environment.timeToLand[after] > state.timeLeft - 1 ? home : action;
  }

  /** The cell over which the nearest device with data left is served, or null if there is none. */
  goal(state) {
    let [goal, fewest] = [null, Infinity];
    state.deviceCells.forEach((cell, device) => {
      if (state.dataLeft[device] <= 0) return;
      const there = this.approach(cell);
      const moves = this.environment.moves(there)[state.uavCell];
      if (moves < fewest) [goal, fewest] = [there, moves];
    });
    return goal;
  }

  /** First action of a shortest path, `hover` where there is none or none is needed. */
  towards(start, goal) {
    const moves = this.environment.moves(goal);
    const nearer = (action) => moves[this.environment.nextCell(start, action)] < moves[start];
    const action = [0, 1, 2, 3].findIndex(nearer);
    return action < 0 ? HOVER : action;
  }

  /** The nearest cell to one that the UAV can reach from a landing zone. */
  approach(cell) {
    return kept(this.approaches, cell, () => {
      const { city } = this.environment;
      const [row, col] = city.position(cell);
      let [nearest, least] = [0, Infinity];
      city.landingDistance.forEach((moves, other) => {
        const [r, c] = city.position(other);
        const squared = (r - row) ** 2 + (c - col) ** 2;
        if (moves >= 0 && squared < least) [nearest, least] = [other, squared];
      });
      return nearest;
    });
  }
}

/** What a network sees: maps of W×W cells, centred or in place, and what is told. */
export class Observation {
  /**
   * @param {import("./world.js").Environment} environment
   * @param {object} recipe of the agent's file
   * @param {number} size M
   */
  constructor(environment, recipe, size) {
    Object.assign(this, { environment, recipe, size, width: 2 * size - 1 });
    this.centred = recipe.observation === "centred";
    this.views = new Map(); // the city's own layers, by the corner of the window
    this.channels = 5 + Number(!this.centred) + (recipe.told ? 3 : 0);
    const farthest = 2 * size;
    this.nearness = (moves) => 1 - (moves < 0 ? farthest : Math.min(moves, farthest)) / farthest;
    this.home = Float32Array.from(environment.city.landingDistance, this.nearness);
  }

  /** @returns {Float32Array} (channels, W, W) */
  map(state) {
    const { environment, recipe, size, width } = this;
    const { city } = environment;
    const area = width ** 2;
    // The window has the UAV in its middle, or the city, half a cell to the north-west if need be
    const margin = size - 1 - Math.floor((width - city.size) / 2);
    const corner = this.centred ? city.position(state.uavCell) : [margin, margin];
    const [down, right] = corner.map((axis) => size - 1 - axis);
    const { size: side } = city;
    const place = (cell) => (Math.floor(cell / side) + down) * width + (cell % side) + right;
    const layers = [city.landing, city.noFly, city.buildings];
    const maps = kept(this.views, down * width + right, () => {
      const view = new Float32Array(this.channels * area);
      view.fill(1, area, 2 * area); // no-fly cells around the city
      for (let cell = 0; cell < environment.cells; cell++)
        layers.forEach((layer, channel) => (view[channel * area + place(cell)] = layer[cell]));
      return view;
    }).slice();
    const told = recipe.told ? this.told(state) : [];
    const first = this.channels - told.length;
    told.forEach((layer, k) =>
      layer.forEach((value, cell) => (maps[(first + k) * area + place(cell)] = value)),
    );
    state.deviceCells.forEach((cell, device) => {
      const left = state.dataLeft[device];
      maps[3 * area + place(cell)] += left / recipe.data_scale;
      maps[4 * area + place(cell)] += (state.dataInitial[device] - left) / recipe.data_scale;
    });
    if (!this.centred) maps[5 * area + place(state.uavCell)] = 1;
    return maps;
  }

  /** The layers that are told: expected data, way home, way there; see beyond/told.py. */
  told(state) {
    const data = new Float32Array(this.environment.cells);
    state.deviceCells.forEach((cell, device) => {
      const left = state.dataLeft[device];
      if (left <= 0) return;
      this.environment.rateMap(cell).forEach((rate, each) => {
        const offered = Math.min(CHANNEL.slots * rate, left) / this.recipe.data_scale;
        data[each] = Math.max(data[each], offered);
      });
    });
    return [data, this.home, Array.from(this.environment.moves(state.uavCell), this.nearness)];
  }
}

const NO_FLY_LAYER = 1; // of the map; outside the city it is 1, and every other layer 0

/** Q-values of all actions: convolutions of one map or two, then fully connected layers. */
class QNetwork {
  /** @param {Object<string, {shape: number[], values: Float32Array}>} tensors by name */
  constructor(recipe, tensors) {
    Object.assign(this, { recipe, tensors });
    this.branches = recipe.pooling ? ["convolutions.0.", "convolutions.1."] : ["convolutions."];
    const inputs = tensors["head.0.weight"].shape[1];
    this.features = new Float32Array(inputs);
  }

  /** @returns {Float32Array} (6,) */
  forward(map, width, time) {
    const { recipe } = this;
    const [whole, side] = wholeFrame(map, width, recipe, recipe.pooling || 1);
    let maps = [{ values: whole, width: side }];
    if (recipe.pooling) {
      const local = Math.min(recipe.local_size, width);
      const [values, full] = wholeFrame(middle(map, width, local).values, local, recipe, 1);
      maps = [averagePool(whole, side, recipe.pooling), { values, width: full }];
    }
    let filled = 0;
    maps.forEach((one, branch) => {
      recipe.strides.forEach((stride, k) => {
        const [weight, bias] = this.layer(`${this.branches[branch]}${2 * k}`);
        one = convolution(one.values, one.width, weight, bias, stride, recipe.leak);
      });
      this.features.set(one.values, filled);
      filled += one.values.length;
    });
    this.features[filled] = time;
    let values = this.features;
    const step = recipe.layer_norm ? 3 : 2;
    recipe.hidden.forEach((_, k) => {
      values = linear(values, ...this.layer(`head.${step * k}`));
      if (recipe.layer_norm) layerNorm(values, ...this.layer(`head.${step * k + 1}`));
      leakyRelu(values, recipe.leak);
    });
    return linear(values, ...this.layer(`head.${step * recipe.hidden.length}`));
  }

  layer(name) {
    return [this.tensors[`${name}.weight`], this.tensors[`${name}.bias`].values];
  }
}

/** Cells as outside the city, to the south and east, so that no layer leaves any out; network.py. */
export function wholeFrame(map, width, { kernel_size, strides }, pooling) {
  const window = strides.reduceRight((cells, stride) => (cells - 1) * stride + kernel_size, 1);
  const step = strides.reduce((product, stride) => product * stride, 1);
  const further = Math.ceil((Math.ceil(width / pooling) - window) / step);
  const side = pooling * (window + Math.max(further, 0) * step);
  if (side === width) return [map, side];
  const framed = new Float32Array((map.length / width ** 2) * side ** 2);
  framed.fill(1, NO_FLY_LAYER * side ** 2, (NO_FLY_LAYER + 1) * side ** 2);
  for (let row = 0; row < map.length / width; row++) {
    const to = Math.floor(row / width) * side ** 2 + (row % width) * side;
    framed.set(map.subarray(row * width, (row + 1) * width), to);
  }
  return [framed, side];
}

/** A kernel over each place of a map, no padding; then the leaky ReLU. */
function convolution(map, width, { shape, values: weights }, bias, stride, leak) {
  const [kernels, channels, side] = shape;
  const [out, area] = [Math.floor((width - side) / stride) + 1, width ** 2];
  const found = new Float32Array(kernels * out ** 2);
  const patch = new Float32Array(channels * side ** 2); // what is under the kernel
  for (let place = 0; place < out ** 2; place++) {
    const begin = Math.floor(place / out) * stride * width + (place % out) * stride;
    let at = 0;
    for (let channel = 0; channel < channels; channel++) {
      for (let r = 0; r < side; r++) {
        const row = begin + channel * area + r * width;
        for (let c = 0; c < side; c++) patch[at++] = map[row + c];
      }
    }
    multiply(weights, patch, bias, found, place, out ** 2);
  }
  leakyRelu(found, leak);
  return { values: found, width: out };
}

/** weights · values + bias, into `found` from one place on, so far apart. */
function multiply(weights, values, bias, found, from, apart) {
  const [inputs, last] = [values.length, bias.length - 1];
  // Four rows at a time, so that a value is read once for them; the last one may come again
  for (let unit = 0; unit <= last; unit += 4) {
    const [u, v, w] = [
      Math.min(unit + 1, last),
      Math.min(unit + 2, last),
      Math.min(unit + 3, last),
    ];
    const row = unit * inputs,
      second = u * inputs,
      third = v * inputs,
      fourth = w * inputs;
    let a = bias[unit],
      b = bias[u],
      c = bias[v],
      d = bias[w];
    for (let k = 0; k < inputs; k++) {
      const value = values[k];
      a += weights[row + k] * value;
      b += weights[second + k] * value;
      c += weights[third + k] * value;
      d += weights[fourth + k] * value;
    }
    found[from + unit * apart] = a;
    found[from + u * apart] = b;
    found[from + v * apart] = c;
    found[from + w * apart] = d;
  }
}

function linear(values, { values: weights }, bias) {
  const found = new Float32Array(bias.length);
  multiply(weights, values, bias, found, 0, 1);
  return found;
}

function layerNorm(values, { values: weight }, bias) {
  const mean = values.reduce((total, value) => total + value, 0) / values.length;
  const variance = values.reduce((sum, value) => sum + (value - mean) ** 2, 0) / values.length;
  const scale = 1 / Math.sqrt(variance + 1e-5);
  for (let k = 0; k < values.length; k++) {
    values[k] = (values[k] - mean) * scale * weight[k] + bias[k];
  }
}

function leakyRelu(values, leak) {
  for (let k = 0; k < values.length; k++) if (values[k] < 0) values[k] *= leak;
}

/** The map averaged over cells of g×g. */
function averagePool(map, width, pooling) {
  const [out, channels] = [Math.floor(width / pooling), map.length / width ** 2];
  const found = new Float32Array(channels * out ** 2);
  found.forEach((_, place) => {
    const [channel, row, col] = [
      Math.floor(place / out ** 2),
      Math.floor(place / out) % out,
      place % out,
    ];
    let total = 0;
    for (let r = 0; r < pooling; r++) {
      const begin = channel * width ** 2 + (row * pooling + r) * width + col * pooling;
      for (let c = 0; c < pooling; c++) total += map[begin + c];
    }
    found[place] = total / pooling ** 2;
  });
  return { values: found, width: out };
}

/** The l×l cells around the UAV. */
function middle(map, width, local) {
  const [margin, channels] = [(width - local) / 2, map.length / width ** 2];
  const found = new Float32Array(channels * local ** 2);
  for (let line = 0; line < channels * local; line++) {
    const begin = (Math.floor(line / local) * width + margin + (line % local)) * width + margin;
    found.set(map.subarray(begin, begin + local), line * local);
  }
  return { values: found, width: local };
}

/** A trained network, and everything needed to fly with it. */
export class Agent {
  /** @param {object} about the JSON of the file's header */
  constructor(about, tensors) {
    const { recipe, size, cities } = about;
    Object.assign(this, { recipe, size });
    this.network = new QNetwork(recipe, tensors);
    /** The city that it was trained in; null if there were many. @type {City | null} */
    this.city = cities.length === 1 ? new City(cities[0].name, tensors.cities) : null;
  }

  /** The same network over a city; raises `InputError` if it is too large for its maps. */
  over(environment) {
    if (environment.size > this.size) {
      throw new InputError(
        `this agent was trained for cities of up to ${this.size} cells on a side, here are ` +
          `${environment.size} (${environment.city.name}): train one for them`,
      );
    }
    return new Flier(this, environment);
  }
}

/** An agent over one city. */
class Flier {
  constructor(agent, environment) {
    Object.assign(this, { agent, environment });
    this.observation = new Observation(environment, agent.recipe, agent.size);
  }

  /** Q-values of all actions, −∞ for those that the failsafe would replace. */
  qValues(state) {
    const { recipe, network } = this.agent;
    const map = this.observation.map(state);
    const values = network.forward(map, this.observation.width, state.timeLeft / recipe.time_scale);
    if (!recipe.failsafe) return values;
    const allowed = safeActions(this.environment, state);
    return values.map((value, action) => (allowed[action] ? value : -Infinity));
  }
}

/** For each cell over which the UAV may fly, the best action there and its Q-value, else null. */
export function valueMap(flier, state) {
  const all = Array.from(flier.environment.city.noFly, (closed, uavCell) =>
    closed ? null : flier.qValues({ ...state, uavCell }),
  );
  const values = all.map((each) => each && Math.max(...each));
  return { values, best: all.map((each, cell) => each && ACTIONS[each.indexOf(values[cell])]) };
}

/** An agent from a checkpoint, the bytes of a safetensors file; `InputError` if it is none. */
export function readAgent(bytes) {
  let [agent, channel] = [];
  try {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const begin = 8 + Number(view.getBigUint64(0, true));
    const { __metadata__: metadata, ...entries } = JSON.parse(
      new TextDecoder().decode(bytes.subarray(8, begin)),
    );
    const about = JSON.parse(metadata.uavdh_lite);
    const tensors = {};
    for (const [name, { dtype, shape, data_offsets: ends }] of Object.entries(entries)) {
      const content = bytes.slice(begin + ends[0], begin + ends[1]);
      const short = name.replace(/^network\.(network\.)?/, "");
      tensors[short] = { shape, values: READ[dtype](content) };
    }
    if (tensors.cities) tensors.cities = tensors.cities.values;
    agent = new Agent(about, tensors);
    channel = about.scenario.channel;
  } catch {
    throw new InputError(
      "not an agent of this package, or a damaged file: open a checkpoint that a training of uavdh_lite saved",
    );
  }
  require(hasChannel(channel), "this agent was trained over another radio channel than the page's");
  return agent;
}

const READ = {
  U8: (content) => content,
  F32: (content) => new Float32Array(content.buffer),
  F16: (content) => new Float32Array(new Float16Array(content.buffer)),
};

export const bytesOf = (base64) => Uint8Array.fromBase64(base64);

/** Letters that tell files apart by their content. */
export function digestOf(bytes) {
  const parts = [0, 1].map((seed) =>
    bytes.reduce((code, byte) => Math.imul(code ^ byte, 16777619 + 2 * seed), ~seed),
  );
  return parts.map((part) => (part >>> 0).toString(16).padStart(8, "0")).join("");
}
