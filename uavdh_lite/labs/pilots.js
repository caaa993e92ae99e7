// Who flies, in JavaScript: what planners, observation, agent and checkpoint do in Python, and of
// beyond told and failsafe, by their names; tests/labs/test_world.py compares
// them. M is the number of cells on a side of the largest city that an agent sees, W = 2M − 1.

import { QNetwork, viewsOf } from "./network.js";
import { ACTIONS, CHANNEL, City, HOVER, Portable, Use, kept, safeActions } from "./world.js";

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
    this.maps = new Float32Array(this.channels * this.width ** 2);
    const farthest = 2 * size;
    this.nearness = (moves) => 1 - (moves < 0 ? farthest : Math.min(moves, farthest)) / farthest;
    this.home = Float32Array.from(environment.city.landingDistance, this.nearness);
  }

  /** @returns {Float32Array} (channels, W, W), the same array each time */
  map(state) {
    const { environment, recipe, size, width, maps } = this;
    const { city } = environment;
    const area = width ** 2;
    // The window has the UAV in its middle, or the city, half a cell to the north-west if need be
    const margin = size - 1 - Math.floor((width - city.size) / 2);
    const corner = this.centred ? city.position(state.uavCell) : [margin, margin];
    const [down, right] = corner.map((axis) => size - 1 - axis);
    const { size: side } = city;
    const place = (cell) => (Math.floor(cell / side) + down) * width + (cell % side) + right;
    const layers = [city.landing, city.noFly, city.buildings];
    const view = kept(this.views, down * width + right, () => {
      const view = new Float32Array(this.channels * area);
      view.fill(1, area, 2 * area); // no-fly cells around the city
      for (let cell = 0; cell < environment.cells; cell++)
        layers.forEach((layer, channel) => (view[channel * area + place(cell)] = layer[cell]));
      return view;
    });
    maps.set(view);
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

/** A trained network, and everything needed to fly with it. */
export class Agent {
  /**
   * @param {object} about the JSON of the file's header
   * @param {object} tensors shape and values by their names in the file
   * @param {string} [digest] the checksum of the file
   */
  constructor(about, { cities, ...tensors }, digest) {
    const { recipe, size, scenario, training } = about;
    const own = (name) => name.replace(/^network\.(network\.)?/, "");
    const named = Object.entries(tensors).map(([name, tensor]) => [own(name), tensor]);
    const first = named.find(([name]) => /^convolutions.*weight/.test(name))[1];
    Object.assign(this, { recipe, size, scenario, training, digest });
    const how = { batch: 1, generator: null };
    this.network = new QNetwork(recipe, first.shape[1], 2 * size - 1, how);
    this.network.tensors = Object.fromEntries(named);
    /** The city that it was trained in; null if there were many. @type {City | null} */
    this.city = about.cities.length === 1 ? new City(about.cities[0].name, cities.values) : null;
  }

  /** The same network over a city that is not too large for its maps. */
  over(environment) {
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
    const views = viewsOf(this.observation.map(state), this.observation.width, recipe);
    const [maps, time] = [views.map(([view]) => view), state.timeLeft / recipe.time_scale];
    const values = network.forward(maps, [time], 1).slice();
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

export const bytesOf = (base64) => Uint8Array.fromBase64(base64);
