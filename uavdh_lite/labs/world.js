// The world in JavaScript: what streams, city, shadowing, channel, environment, beyond/failsafe,
// scenario and missions do in Python, in their order and by their names. Whoever changes
// one changes the other; tests/labs/test_world.py compares them.
//
// A cell is a number, row · M + column, where M is the number of cells on a side; n = M². A mask is
// a Uint8Array of n zeros and ones. δ is the number of communication slots in a step, K that of
// places for devices. There is one episode, not a batch.

/** A message for people about what they gave. */
export class InputError extends Error {}

/** Throws the reason, an `InputError`, unless it holds. */
export function require(holds, otherwise) {
  if (!holds) throw new InputError(otherwise);
}

export const Use = {
  TRAINING: 0,
  VALIDATION: 1,
  MISSION: 4,
  FADING: 5,
  EXPLORATION: 6,
  WEIGHTS: 11,
};

/** The numbers of one use and seed, the same in every language: the k-th is a hash of k. */
export class Portable {
  /** @param {number} use of `Use`  @param {number} seed a whole number, 0 to 2**53 − 1 */
  constructor(use, seed) {
    const fits = Number.isSafeInteger(seed) && seed >= 0;
    require(fits, `seed ${seed}: must be a whole number from 0 to 2**53 - 1`);
    this.key = hash((seed % 2 ** 32) + hash(Math.floor(seed / 2 ** 32) + hash(use)));
    this.drawn = 0;
  }

  /** Uniform over [0, 1), a multiple of 2**−32. */
  random() {
    return hash(this.key + this.drawn++) / 2 ** 32;
  }

  uniform(low, high) {
    return low + (high - low) * this.random();
  }

  integers(low, high, endpoint = false) {
    return low + Math.floor(this.random() * (high - low + Number(endpoint)));
  }

  /** By Box and Muller, two numbers for each. */
  standardNormal() {
    const radius = Math.sqrt(-2 * Math.log(1 - this.random()));
    return radius * Math.cos(2 * Math.PI * this.random());
  }
}

/** A hash of 32 bits: Wellons' triple32. */
function hash(number) {
  number >>>= 0;
  number = Math.imul(number ^ (number >>> 17), 0xed5ad4bb);
  number = Math.imul(number ^ (number >>> 11), 0xac4c1b51);
  number = Math.imul(number ^ (number >>> 15), 0x31848bab);
  return (number ^ (number >>> 14)) >>> 0;
}

// The city

export const MAX_SIZE = 100; // cells on a side
export const SIGNS = ".NbLB"; // free, no-fly zone, low building, landing zone, tall building
export const COLOURS = [
  [0, 0, 0],
  [255, 0, 0],
  [0, 255, 0],
  [0, 0, 255],
  [255, 255, 0],
];
const UNPRINTABLE = /[\p{C}\p{Zl}\p{Zp}]|(?! )\p{Zs}/gu; // as in city.py
const [ON, OFF] = [224, 31]; // a channel is set from ON upwards, not set from OFF downwards

/** A city of M×M cells; see city.py. Raises `InputError` for what cannot be one. */
export class City {
  /** @param {string} name  @param {ArrayLike<number>} kinds (n,), indices into `SIGNS` */
  constructor(name, kinds) {
    this.name = `${name}`.replace(UNPRINTABLE, "?");
    this.kinds = Uint8Array.from(kinds);
    this.size = Math.sqrt(this.kinds.length);
    this.landing = this.kinds.map((kind) => kind === 3);
    this.noFly = this.kinds.map((kind) => kind === 1 || kind === 4);
    this.buildings = this.kinds.map((kind) => kind === 2 || kind === 4);
    /** Where a device may stand. */
    this.openToDevices = this.kinds.map((kind) => kind < 2);
    const open = this.noFly.map((closed) => 1 - closed);
    const free = grow(open, this.size);
    const walledIn = this.landing.findIndex((there, cell) => there && !free[cell]);
    const [row, col] = this.position(walledIn);
    const { size } = this;
    require(size <= MAX_SIZE, `${name}: ${size} cells on a side, at most ${MAX_SIZE} fit`);
    const [starts, devices] = [this.landing, this.openToDevices].map((mask) => mask.includes(1));
    require(starts, `${name}: no start and landing zone; paint at least one cell blue`);
    const lies = `landing cell row ${row}, column ${col} lies inside a no-fly zone`;
    require(walledIn < 0 || size === 1, `${name}: ${lies}: the UAV cannot leave it; ` +
      "free a cell to its north, east, south or west");
    require(devices, `${name}: no cell for a device: all are buildings or landing zone; free one`);
    /** Moves from each cell to the nearest landing cell, −1 if none is reachable; Int16Array. */
    this.landingDistance = new Int16Array(this.kinds.length).fill(-1);
    for (let [moves, reached] = [0, this.landing]; reached.includes(1); moves++) {
      reached.forEach((there, cell) => there && (this.landingDistance[cell] = moves));
      const ahead = grow(reached, this.size);
      reached = ahead.map((there, c) => there && !this.noFly[c] && this.landingDistance[c] < 0);
    }
  }

  /** One line per row in `SIGNS`; blanks are ignored. */
  static fromText(name, text) {
    const rows = text
      .trim()
      .split("\n")
      .map((line) => line.replace(/\s/g, ""));
    rows.forEach((row, r) => {
      const square = row.length === rows.length;
      require(square, `${name}: ${rows.length} rows, but row ${r} has ${row.length} cells`);
      const c = [...row].findIndex((sign) => !SIGNS.includes(sign));
      require(c < 0, `${name}: row ${r}, column ${c}: '${row[c]}' is none of ${SIGNS}`);
    });
    const kinds = [...rows.join("")].map((sign) => SIGNS.indexOf(sign));
    return new City(name, kinds);
  }

  /** A picture's city, one pixel a cell.  @param {ArrayLike<number>} rgba four bytes a pixel */
  static fromPixels(name, width, height, rgba) {
    const fits = Math.max(width, height) <= MAX_SIZE;
    require(fits, `${name}: ${width} × ${height} pixels, at most ${MAX_SIZE} on a side fit`);
    const code = (bytes) => `#${bytes.map((byte) => byte.toString(16).padStart(2, "0")).join("")}`;
    const kinds = Array.from({ length: width * height }, (_, pixel) => {
      const parts = [0, 1, 2, 3].map((channel) => rgba[4 * pixel + channel]);
      const clear = parts.every((part, k) => (k < 3 ? part >= ON || part <= OFF : part === 255));
      const kind = COLOURS.findIndex((colour) =>
        colour.every((part, k) => part > 0 === parts[k] >= ON),
      );
      const where = `${name}: pixel row ${Math.floor(pixel / width)}, column ${pixel % width} is`;
      const shown = `${code(parts)}${parts[3] === 255 ? "" : " (not opaque)"}`;
      const found = `${where} ${shown}, not one of ${COLOURS.map(code).join(", ")}`;
      require(clear && kind >= 0, found);
      return kind;
    });
    const size = `${width} × ${height} cells`;
    require(width === height, `${name}: a city must be square, this one is ${size}`);
    return new City(name, kinds);
  }

  /** As it stands in a mission's file. @returns {string[]} */
  get rows() {
    const signs = Array.from(this.kinds, (kind) => SIGNS[kind]).join("");
    return Array.from({ length: this.size }, (_, r) => signs.slice(r * this.size, ++r * this.size));
  }

  /** As a picture, four bytes a pixel. */
  get pixels() {
    return Uint8ClampedArray.from([...this.kinds].flatMap((kind) => [...COLOURS[kind], 255]));
  }

  sameAs(other) {
    return this.rows.join() === other.rows.join();
  }

  /** The number of a cell. @param {[number, number]} position row and column */
  cell([row, col]) {
    return row * this.size + col;
  }

  /** @returns {[number, number]} row and column of a cell */
  position(cell) {
    return [Math.floor(cell / this.size), cell % this.size];
  }
}

/** The cells with a neighbour in the mask to the north, east, south or west. */
function grow(mask, size) {
  return mask.map((_, cell) => {
    const col = cell % size;
    const [west, east] = [col > 0 && mask[cell - 1], col < size - 1 && mask[cell + 1]];
    return mask[cell - size] || mask[cell + size] || west || east ? 1 : 0;
  });
}

// Shadow maps

/** Which cells are seen from one: a row of Python's table; all zeros if it is a building. */
export function lineOfSight(buildings, size, cell) {
  const [row, col] = [Math.floor(cell / size), cell % size];
  const is = ([r, c]) => buildings[(row + r) * size + col + c];
  return buildings.map((_, goal) => {
    const [rows, cols] = [Math.floor(goal / size) - row, (goal % size) - col];
    const blocked = crossedCells(rows, cols).some(is);
    return !blocked && !passedCorners(rows, cols).some(([a, b]) => is(a) && is(b)) ? 1 : 0;
  });
}

/** The cells whose open interior the segment from (0, 0) to (rows, cols) crosses; see Python. */
export function crossedCells(rows, cols) {
  const [found, width] = [[], Math.max(Math.abs(rows) + Math.abs(cols), 1)];
  const [west, east] = [Math.min(cols, 0), Math.max(cols, 0)];
  for (let r = Math.min(rows, 0); r <= Math.max(rows, 0); r++) {
    // Only near the segment: `reach` columns to each side, all of them if it stays in one row
    const [middle, reach] = rows ? [(cols * r) / rows, width / Math.abs(2 * rows)] : [0, Infinity];
    const last = Math.min(east, Math.floor(middle + reach));
    for (let c = Math.max(west, Math.ceil(middle - reach)); c <= last; c++) {
      if (2 * Math.abs(rows * c - cols * r) < width) found.push([r, c]);
    }
  }
  return found;
}

/** The pairs of cells between which the segment passes through a corner; see Python. */
export function passedCorners(rows, cols) {
  let [common, rest] = [Math.abs(rows), Math.abs(cols)];
  while (rest) [common, rest] = [rest, common % rest];
  const [down, right] = [rows / Math.max(common, 1), cols / Math.max(common, 1)];
  if (down % 2 === 0 || right % 2 === 0) return [];
  const [r, c] = [Math.sign(down), Math.sign(right)];
  return Array.from({ length: common }, (_, k) => {
    const corner = [(2 * k + 1) * down, (2 * k + 1) * right]; // doubled, to be whole numbers
    const beside = (side) => [(corner[0] + side * r) / 2, (corner[1] - side * c) / 2];
    return [beside(1), beside(-1)];
  });
}

// The channel

export const CHANNEL = {
  cellSize: 10, // m
  altitude: 10, // m
  cellEdgeSnr: -15, // dB
  pathLossExponent: [3.64, 2.27], // without and with a line of sight
  fadingVariance: [5, 2], // dB², likewise
  slots: 4, // δ
};
const PAPERS = { ...CHANNEL };

/** The constants of channel.py, whose names they have there, as `CHANNEL` has them. */
const named = (values) => ({
  cellSize: values.cell_size_m,
  altitude: values.altitude_m,
  cellEdgeSnr: values.cell_edge_snr_db,
  pathLossExponent: [values.path_loss_exponent_nlos, values.path_loss_exponent_los],
  fadingVariance: [values.fading_variance_nlos_db2, values.fading_variance_los_db2],
  slots: values.slots,
});

/** From now on the page has this channel. */
export const setChannel = (values) => void Object.assign(CHANNEL, named(values));

/** Whether the page has this channel; a file of version 0.3 names none and means the paper's. */
export const hasChannel = (values) =>
  JSON.stringify(values ? named(values) : PAPERS) === JSON.stringify(CHANNEL);

/** P/σ² in dB, from the cell-edge SNR of a city of size×size cells. */
export function transmitSnrDb(size) {
  const edge = (Math.SQRT2 * size * CHANNEL.cellSize) / 2;
  return CHANNEL.cellEdgeSnr + 10 * CHANNEL.pathLossExponent[1] * Math.log10(edge);
}

/** 10 α log10 d in dB, from the squared 3-D distance, m². */
export function pathLossDb(squaredDistance, sight) {
  return 5 * CHANNEL.pathLossExponent[sight] * Math.log10(squaredDistance);
}

/** Shadow fading η in dB from a standard normal draw. */
export function fadingDb(standardNormal, sight) {
  return standardNormal * Math.sqrt(CHANNEL.fadingVariance[sight]);
}

/** Data units in one communication slot at this SNR: log2(1 + SNR). */
export function rate(snrDb) {
  return Math.log2(1 + 10 ** (snrDb / 10));
}

// The decision process

export const ACTIONS = ["north", "east", "south", "west", "hover", "land"];
export const [NORTH, EAST, SOUTH, WEST, HOVER, LAND] = ACTIONS.keys();
const MOVES = { row: [-1, 0, 1, 0, 0, 0], col: [0, 1, 0, -1, 0, 0] };
export const NO_PATH = 32767; // stands for the number of moves where no path leads

/**
 * @typedef {object} State of one episode; nothing in it is ever changed
 * @property {number} uavCell
 * @property {number} timeLeft units of time
 * @property {Int16Array} deviceCells (K,)
 * @property {Float32Array} dataInitial (K,), data units
 * @property {Float32Array} dataLeft (K,), data units
 * @property {boolean} landed
 *
 * @typedef {object} Outcome what happened in one step
 * @property {Int8Array} served (δ,), the device that had the slot, −1 for none
 * @property {Float32Array} uploaded (δ,), data units
 * @property {boolean} intervened the safety controller replaced the action by hovering
 * @property {boolean} landed
 * @property {boolean} crashed the time ran out in this step without a landing
 */

/** Whether the episode is over: landed, or no flying time left. */
export const ended = (state) => state.landed || state.timeLeft <= 0;

export const REWARDS = { data: 1, movement: -0.2, safety: -1, crash: -150 };

/** @param {object} rewards their constants */
export function reward({ uploaded, landed, intervened, crashed }, rewards = REWARDS) {
  const penalties = [!landed && "movement", intervened && "safety", crashed && "crash"];
  return rewards.data * sum(uploaded) + sum(penalties.map((name) => (name ? rewards[name] : 0)));
}

export const sum = (values) => values.reduce((total, value) => total + value, 0);

/** A UAV over a city collects data from devices on the ground and must land in time. */
export class Environment {
  /** @param {City} city */
  constructor(city) {
    Object.assign(this, { city, size: city.size, cells: city.kinds.length });
    this.transmitSnrDb = transmitSnrDb(city.size);
    this.rows = { sight: new Map(), moves: new Map(), rate: new Map() }; // as they are needed
    /** Units of time to fly home and land, `NO_PATH` where there is no path; (n,) */
    this.timeToLand = city.landingDistance.map((moves) => (moves < 0 ? NO_PATH : moves + 1));
    this.wayHome = this.findWaysHome();
  }

  /** Where an action leads, or null off the grid. */
  target(cell, action) {
    const here = this.city.position(cell);
    const [row, col] = [here[0] + MOVES.row[action], here[1] + MOVES.col[action]];
    const inside = Math.min(row, col) >= 0 && Math.max(row, col) < this.size;
    return inside ? row * this.size + col : null;
  }

  /** The UAV's cell after an action. */
  nextCell(cell, action) {
    return this.forbidden(cell, action) ? cell : this.target(cell, action);
  }

  /** Whether the safety controller replaces an action. */
  forbidden(cell, action) {
    if (action === LAND) return !this.city.landing[cell];
    const target = this.target(cell, action);
    return action !== HOVER && (target === null || Boolean(this.city.noFly[target]));
  }

  /** First action of a shortest path to the nearest landing cell; (n,). Ties: the lowest cell. */
  findWaysHome() {
    const distance = this.city.landingDistance;
    const action = Uint8Array.from(distance, (moves) => (moves === 0 ? LAND : HOVER));
    const goal = Array.from(distance, (moves, cell) => (moves === 0 ? cell : Infinity));
    const order = [...distance.keys()].sort((a, b) => distance[a] - distance[b]);
    for (const cell of order.filter((each) => distance[each] > 0)) {
      for (let move = 0; move < HOVER; move++) {
        const ahead = this.nextCell(cell, move);
        if (distance[ahead] === distance[cell] - 1 && goal[ahead] < goal[cell]) {
          [action[cell], goal[cell]] = [move, goal[ahead]];
        }
      }
    }
    return action;
  }

  /** The cells that are seen from one. */
  sight(cell) {
    return kept(this.rows.sight, cell, () => lineOfSight(this.city.buildings, this.size, cell));
  }

  /** Moves between a cell and every other, `NO_PATH` where no path leads; Int16Array (n,). */
  moves(cell) {
    return kept(this.rows.moves, cell, () => shortestPaths(this, cell));
  }

  /** Data units a slot, without fading, from a device in a cell to a UAV over each; (n,). */
  rateMap(cell) {
    return kept(this.rows.rate, cell, () => this.snrMap(cell).map(rate));
  }

  /** The SNRs of `rateMap`, dB. */
  snrMap(cell) {
    const [[row, col], sight] = [this.city.position(cell), this.sight(cell)];
    return Float64Array.from(sight, (sees, each) => {
      const [r, c] = this.city.position(each);
      const ground = ((r - row) ** 2 + (c - col) ** 2) * CHANNEL.cellSize ** 2;
      return this.transmitSnrDb - pathLossDb(ground + CHANNEL.altitude ** 2, sees);
    });
  }

  /** The actions that the safety controller would not replace. @returns {boolean[]} (6,) */
  allowedActions(state) {
    return ACTIONS.map((_, action) => !this.forbidden(state.uavCell, action));
  }

  /** Standard normal draws for one step, slot by slot; Float32Array (δ · K,). */
  drawFading(state, generator) {
    const draws = new Float32Array(CHANNEL.slots * state.deviceCells.length);
    return draws.map(() => generator.standardNormal());
  }

  /** One step of an episode that is not over. @returns {{state: State, outcome: Outcome}} */
  transition(state, action, fading) {
    const intervened = this.forbidden(state.uavCell, action);
    const uavCell = this.nextCell(state.uavCell, action);
    const timeLeft = state.timeLeft - 1;
    const landed = action === LAND && !intervened;
    const crashed = !landed && timeLeft === 0;
    const snrDb = this.snrDb(state, uavCell, fading);
    if (landed || crashed) snrDb.fill(-Infinity); // nothing is heard
    const { served, uploaded, dataLeft } = schedule(snrDb, state.dataLeft);
    return {
      state: { ...state, uavCell, timeLeft, dataLeft, landed },
      outcome: { served, uploaded, intervened, landed, crashed },
    };
  }

  /** SNR of every device in every slot of a step, dB; Float32Array (δ · K,) (eq. 1–4). */
  snrDb(state, nextCell, fading) {
    const [start, end] = [state.uavCell, nextCell].map((cell) => this.city.position(cell));
    const devices = state.deviceCells.length;
    return fading.map((draw, place) => {
      const share = (Math.floor(place / devices) + 1) / CHANNEL.slots;
      const device = state.deviceCells[place % devices];
      const [down, right] = this.city
        .position(device)
        .map((axis, i) => CHANNEL.cellSize * (axis - start[i] - share * (end[i] - start[i])));
      const sight = this.sight(device)[share < 0.5 ? state.uavCell : nextCell];
      const loss = pathLossDb(CHANNEL.altitude ** 2 + down ** 2 + right ** 2, sight);
      return this.transmitSnrDb - loss + fadingDb(draw, sight);
    });
  }
}

/** What a map holds under a key, made when it is first needed. */
export function kept(map, key, make) {
  if (!map.has(key)) map.set(key, make());
  return map.get(key);
}

/** TDMA: each slot goes to the device with the highest SNR among those with data left. */
export function schedule(snrDb, dataLeft) {
  const [left, slots] = [dataLeft.slice(), CHANNEL.slots];
  const served = new Int8Array(slots).fill(-1);
  const uploaded = new Float32Array(slots);
  for (let slot = 0; slot < slots; slot++) {
    let best = -Infinity;
    for (let device = 0; device < left.length; device++) {
      const heard = snrDb[slot * left.length + device];
      if (left[device] > 0 && heard > best) [best, served[slot]] = [heard, device];
    }
    if (served[slot] < 0) continue;
    uploaded[slot] = Math.min(rate(best), left[served[slot]]);
    left[served[slot]] -= uploaded[slot];
  }
  return { served, uploaded, dataLeft: left };
}

/** Moves from a cell to all others, `NO_PATH` where no path leads; Int16Array (n,). */
export function shortestPaths(environment, cell) {
  const moves = new Int16Array(environment.cells).fill(NO_PATH);
  if (environment.city.noFly[cell]) return moves;
  moves[cell] = 0;
  for (const queue = [cell]; queue.length;) {
    const here = queue.shift();
    for (let action = 0; action < HOVER; action++) {
      const ahead = environment.nextCell(here, action);
      if (moves[ahead] === NO_PATH) {
        moves[ahead] = moves[here] + 1;
        queue.push(ahead);
      }
    }
  }
  return moves;
}

/** The failsafe: whether each action is allowed and leaves time to land, if there is any. */
export function safeActions(environment, state) {
  const { timeToLand } = environment;
  const possible = timeToLand[state.uavCell] <= state.timeLeft;
  return environment.allowedActions(state).map((allowed, action) => {
    const after = timeToLand[environment.nextCell(state.uavCell, action)] <= state.timeLeft - 1;
    return allowed && (!possible || after || action === LAND);
  });
}

// Missions

/**
 * @typedef {object} Scenario the ranges from which a mission is drawn, both ends included
 * @property {[number, number]} devices
 * @property {[number, number]} data of each device, data units
 * @property {[number, number]} flying_time units of time
 */

/** One episode: start, devices and their data, flying time, seed of the fading; see missions.py. */
export class Mission {
  /**
   * Raises `InputError` if it cannot be flown.
   * @param {{city: City, start: [number, number], devices: [number, number][], data: number[],
   *   flyingTime: number, seed?: number, maxDevices?: number}} values
   */
  constructor(values) {
    Object.assign(this, { seed: 0, maxDevices: 5 }, values);
    this.state = this.firstState();
    this.fading();
  }

  /** A random mission of a scenario; equal seeds draw equal ones in any language. */
  static draw(scenario, city, seed) {
    const [generator, most] = [new Portable(Use.MISSION, seed), scenario.devices[1]];
    const cellsOf = (mask) => [...mask.keys()].filter((cell) => mask[cell]);
    const open = cellsOf(city.openToDevices);
    const room = `${city.name} has ${open.length} cells for them`;
    require(most <= open.length, `scenario ${scenario.name}: up to ${most} devices, but ${room}`);
    generator.random(); // chooses the city, where there are several
    const rank = open.map((cell) => [generator.random(), cell]).sort((a, b) => a[0] - b[0]);
    const count = generator.integers(...scenario.devices, true);
    const data = Array.from({ length: most }, () => generator.uniform(...scenario.data));
    const landing = cellsOf(city.landing);
    const start = city.position(landing[generator.integers(0, landing.length)]);
    const flyingTime = generator.integers(...scenario.flying_time, true);
    const used = [...Array(count).keys()].filter((device) => data[device] > 0);
    return new Mission({
      city,
      start,
      devices: used.map((device) => city.position(rank[device][1])),
      data: used.map((device) => Number(Math.fround(data[device]).toFixed(1))),
      flyingTime,
      seed,
      maxDevices: most,
    });
  }

  /** Another mission with some changes. */
  with(changes) {
    const { city, start, devices, data, flyingTime, seed, maxDevices } = this;
    return new Mission({ city, start, devices, data, flyingTime, seed, maxDevices, ...changes });
  }

  /** @returns {State} */
  firstState() {
    const { city, start, devices, data, flyingTime, maxDevices } = this;
    const [count, size, limit] = [devices.length, city.size, 2 ** 15];
    const told = ([row, col]) => `(${row}, ${col})`;
    const inside = (axis) => Number.isInteger(axis) && axis >= 0 && axis < size;
    const requireInside = (position, what) =>
      require(position.length === 2 && position.every(inside), `${what} at ${told(position)} is ` +
        `outside the city of ${size} × ${size} cells: rows and columns go from 0 to ${size - 1}`);
    const change = count ? "take some away" : "add one";
    const fits = count >= 1 && count <= maxDevices && maxDevices <= 100;
    require(fits, `${count} devices: this scenario takes 1 to ${maxDevices}; ${change}`);
    const each = `${count} devices but ${data.length} amounts of data: give one each`;
    require(data.length === count, each);
    const time = Number.isInteger(flyingTime) && flyingTime >= 1 && flyingTime < limit;
    require(time, `flying time ${flyingTime}: must be at least 1 and below ${limit}`);
    requireInside(start, "the UAV");
    const uavCell = city.cell(start);
    const there = city.buildings[uavCell] ? "a building" : "a no-fly zone";
    require(!city.noFly[uavCell], `the UAV cannot start at ${told(start)}, ${there}: move it`);
    const cells = devices.map((position) => city.cell(position));
    devices.forEach((position, k) => {
      requireInside(position, `device ${k}`);
      const stands = {
        "on a building": city.buildings[cells[k]],
        "in the landing zone": city.landing[cells[k]],
        "where another device stands": cells.indexOf(cells[k]) < k,
      };
      const where = Object.keys(stands).find((each) => stands[each]);
      require(!where, `device ${k} at ${told(position)} stands ${where}: move it`);
      const amount = Number.isFinite(data[k]) && data[k] >= 0 && data[k] < limit;
      require(amount, `device ${k} has ${data[k]} data units: must be 0 to below ${limit}`);
    });
    require(data.some(Boolean), "no device has data: give at least one a positive amount");
    const deviceCells = new Int16Array(maxDevices);
    deviceCells.set(cells);
    const dataInitial = new Float32Array(maxDevices);
    dataInitial.set(data);
    return {
      uavCell,
      timeLeft: flyingTime,
      deviceCells,
      dataInitial,
      dataLeft: dataInitial,
      landed: false,
    };
  }

  /** A new generator of this mission's fading, as it is at the start. */
  fading() {
    return new Portable(Use.FADING, this.seed);
  }

  /** What a mission's file holds. */
  asJson() {
    return {
      format: FORMAT,
      version: VERSION,
      city: { name: this.city.name, rows: this.city.rows },
      start: this.start,
      devices: this.devices.map((cell, k) => ({ cell, data: this.data[k] })),
      flying_time: this.flyingTime,
      seed: this.seed,
      max_devices: this.maxDevices,
    };
  }
}

const [FORMAT, VERSION] = ["uavdh_lite mission", 1];

/**
 * @typedef {object} Trajectory one episode of T steps
 * @property {State[]} states (T + 1,), of which the next three are parts
 * @property {number[]} uavCell (T + 1,)
 * @property {number[]} timeLeft (T + 1,)
 * @property {Float32Array[]} dataLeft (T + 1, K)
 * @property {number[]} action (T,)
 * @property {boolean[]} intervened (T,)
 * @property {number[]} reward (T,)
 * @property {boolean} landed
 */

/** A mission flown step by step; it has the same fading as any policy that flies the mission. */
export class HandFlight {
  constructor(environment, mission) {
    Object.assign(this, { environment, mission, states: [mission.state], steps: [] });
    this.generator = mission.fading();
  }

  get state() {
    return this.states.at(-1);
  }

  get ended() {
    return ended(this.state);
  }

  /** Take one action, an index into `ACTIONS`; `InputError` after the end. @returns {Outcome} */
  step(action) {
    if (this.ended) throw new InputError("this flight is over: start another one");
    const fading = this.environment.drawFading(this.state, this.generator);
    const { state, outcome } = this.environment.transition(this.state, action, fading);
    this.states.push(state);
    this.steps.push({ action, outcome });
    return outcome;
  }

  /** The flight so far. @returns {Trajectory} */
  get trajectory() {
    const { states, steps } = this;
    return {
      states,
      uavCell: states.map((state) => state.uavCell),
      timeLeft: states.map((state) => state.timeLeft),
      dataLeft: states.map((state) => state.dataLeft),
      action: steps.map((step) => step.action),
      intervened: steps.map((step) => step.outcome.intervened),
      reward: steps.map((step) => reward(step.outcome)),
      landed: this.state.landed,
    };
  }
}

/** The mission that a file holds; `InputError` says what is wrong. */
export function missionFromJson(values) {
  const { format, version, city, start, devices, flying_time: flyingTime } = values ?? {};
  const { seed, max_devices: maxDevices } = values ?? {};
  require(format === FORMAT && version === VERSION, `this is no mission of version ${VERSION}`);
  try {
    const [places, data] = ["cell", "data"].map((name) => devices.map((each) => each[name]));
    require(city.name.length, "the city of this mission has no name: give it one");
    const there = City.fromText(city.name, city.rows.join("\n"));
    return new Mission({ city: there, start, devices: places, data, flyingTime, seed, maxDevices });
  } catch (error) {
    if (error instanceof InputError) throw error;
    throw new InputError("the mission in this file is damaged: save it again");
  }
}

// Evaluation

/** The mean with Student's 95 % interval; its t by the expansion of Cornish and Fisher. */
export function studentInterval(values) {
  const [count, mean, z] = [values.length, sum(values) / values.length, 1.959964];
  const free = count - 1;
  const t = z + (z ** 3 + z) / (4 * free) + (5 * z ** 5 + 16 * z ** 3 + 3 * z) / (96 * free ** 2);
  const half = t * Math.sqrt(sum(values.map((each) => (each - mean) ** 2)) / (free * count));
  return [mean, mean - half, mean + half];
}
