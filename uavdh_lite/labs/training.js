// DDQN learns: what scenario, replay, ddqn and training do in Python, under their names, with dials
// that act while it learns. tests/labs/test_learning.py says what each dial does.

import { QNetwork, viewsOf } from "./network.js";
import { Observation } from "./pilots.js";
import { ACTIONS, City, Environment, Portable, REWARDS, Use, ended, reward, sum } from "./world.js";

const MOST = 40_000; // transitions are kept; the dial chooses how many of the newest are drawn
const MISSIONS = 50; // of each point of the curves; they are the same each time
const [POINTS, LEAST] = [48, 500]; // points of the curves, steps between two

/**
 * @typedef {object} Dials the recipe's fields, by their names in recipe.py, and others
 * @property {boolean} double the online network chooses the action that the target values
 * @property {boolean} frozen the target network stays as it is
 * @property {number} seed
 *
 * @typedef {object} Point of the curves: means over missions flown greedily
 * @property {number} steps environment steps
 * @property {number} landed
 * @property {number} collected
 * @property {number} home the share of the data that is brought home: 0 without a landing
 * @property {number} return
 * @property {number | null} loss the mean since the point before
 */

/** Dials whose change gives the network another shape, or other inputs: then it begins anew. */
export const ANEW = ["observation", "data_scale", "time_scale", "layer_norm", "seed"];

/** Linear from `start` at step 0 to `end` at step `over`, and `end` from then on; see recipe.py. */
export function ramp(start, end, step, over) {
  if (end === null) return start;
  return start + (end - start) * (over > 0 ? Math.min(step / over, 1) : 1);
}

/** The place of the largest of the six Q-values in a row; 0 where they are no numbers any more. */
export function best(values, row) {
  let place = 0;
  const begin = row * ACTIONS.length;
  for (let action = 1; action < ACTIONS.length; action++)
    if (values[begin + action] > values[begin + place]) place = action;
  return place;
}

/** A ring of the last steps of all environments; see replay.py. */
class Replay {
  constructor(environments) {
    const steps = Math.ceil(MOST / environments) + 100; // the last returns are not whole
    Object.assign(this, { environments, steps, head: 0, filled: 0 });
    this.states = Array(steps * environments);
    this.action = new Int8Array(steps * environments);
    this.reward = new Float32Array(steps * environments);
    this.end = new Uint8Array(steps * environments); // 1: landed in this step, 2: crashed
  }

  /** How many transitions can be drawn. */
  count({ replay_capacity, return_steps }) {
    const whole = Math.max(this.filled - return_steps + 1, 0);
    const most = Math.ceil(Math.min(replay_capacity, MOST) / this.environments);
    return Math.min(whole, most) * this.environments;
  }

  add(states, actions, rewards, ends) {
    const begin = this.head * this.environments;
    for (let k = 0; k < this.environments; k++) {
      this.states[begin + k] = states[k];
      this.action[begin + k] = actions[k];
      this.reward[begin + k] = rewards[k];
      this.end[begin + k] = ends[k];
    }
    this.head = (this.head + 1) % this.steps;
    this.filled = Math.min(this.filled + 1, this.steps - 1);
  }

  /** Adds to the rewards of all crashes that are kept. */
  reprice(more) {
    for (let at = 0; at < this.end.length; at++) if (this.end[at] === 2) this.reward[at] += more;
  }

  /**
   * Different transitions: the newest of each environment, then others uniformly.
   * @param {object[]} now the states in which the environments are
   */
  sample(size, recipe, generator, now) {
    const { environments, steps } = this;
    const chosen = new Set(Array(environments).keys());
    const older = this.count(recipe) - environments;
    for (let top = older - (size - environments); top < older; top++) {
      // Floyd's way to draw without replacement
      const drawn = environments + generator.integers(0, top + 1);
      chosen.add(chosen.has(drawn) ? environments + top : drawn);
    }
    return [...chosen].map((number) => {
      const [age, column] = [Math.floor(number / environments), number % environments];
      const back = age + recipe.return_steps;
      const first = ((this.head - back + steps) % steps) * environments + column;
      let [total, discount, at, taken] = [0, 1, first, 0];
      while (taken < recipe.return_steps && discount > 0) {
        total += discount * this.reward[at];
        discount *= this.end[at] ? 0 : recipe.discount;
        at = (at + environments) % this.end.length;
        taken += 1;
      }
      const next = taken === back ? now[column] : this.states[at];
      return {
        state: this.states[first],
        action: this.action[first],
        reward: total,
        discount,
        next,
      };
    });
  }
}

/** A run over one city. */
export class Trainer {
  /**
   * @param {{city: object, scenario: object, dials: Dials}} told the city with name and rows
   */
  constructor({ city, scenario, dials }) {
    const { seed, batch_size, environments } = dials;
    const environment = new Environment(City.fromText(city.name, city.rows.join("\n")));
    Object.assign(this, { environment, scenario, dials: { ...dials } });
    Object.assign(this, { steps: 0, updates: 0, points: [], losses: [], turned: [] });
    this.generator = new Portable(Use.TRAINING, seed);
    this.replay = new Replay(environments);
    const { landing, openToDevices, kinds } = environment.city;
    const cellsOf = (mask) => [...kinds.keys()].filter((cell) => mask[cell]);
    [this.landing, this.open] = [cellsOf(landing), cellsOf(openToDevices)];
    this.states = Array.from({ length: environments }, () => this.start(this.generator));
    this.observation = new Observation(environment, dials, environment.size);
    const rows = Math.max(batch_size, MISSIONS, environments);
    this.maps = new Float64Array(rows * this.mapOf(this.states[0]).length);
    this.times = new Float64Array(rows);
    this.slopes = new Float64Array(rows * ACTIONS.length);
    const { channels, width } = this.observation;
    const network = () => {
      const generator = new Portable(Use.WEIGHTS, seed);
      return new QNetwork(dials, channels, width, { batch: rows, generator });
    };
    [this.online, this.target] = [network(), network()];
    const missions = new Portable(Use.VALIDATION, 0);
    this.missions = Array.from({ length: MISSIONS }, () => this.start(missions));
    this.measure();
  }

  get finished() {
    return this.steps >= this.dials.steps;
  }

  /** Turns dials. What they change is so from the next step on. */
  turn(dials) {
    const before = this.crashReward;
    Object.assign(this.dials, dials);
    this.replay.reprice(this.crashReward - before); // of crashes remembered
    this.turned.push([this.steps, dials]);
  }

  /** Takes what an agent has learned, and stands where its run ended. @returns {Dials} */
  take({ network, training: { seed, steps, updates } }) {
    this.online.tensors = network.tensors;
    this.target.follow(this.online, 1);
    Object.assign(this, { steps, updates, turned: [], dials: { ...this.dials, steps, seed } });
    this.measure();
    return this.dials;
  }

  get crashReward() {
    const { crash_reward, crash_reward_end, crash_reward_growth, steps } = this.dials;
    return ramp(crash_reward, crash_reward_end, this.steps, crash_reward_growth * steps);
  }

  get temperature() {
    const { temperature, temperature_end, temperature_decay, steps } = this.dials;
    return ramp(temperature, temperature_end, this.steps, temperature_decay * steps);
  }

  get learningRate() {
    const { learning_rate, learning_rate_end, steps } = this.dials;
    return ramp(learning_rate, learning_rate_end, this.steps, steps);
  }

  /** Transitions that must be there before it learns. */
  get prefill() {
    const { replay_prefill, replay_capacity } = this.dials;
    return Math.min(replay_prefill, replay_capacity);
  }

  /** The start of an episode of the scenario. */
  start(generator) {
    const { devices, data, flying_time } = this.scenario;
    const cells = new Set();
    while (cells.size < devices[1]) cells.add(this.open[generator.integers(0, this.open.length)]);
    const count = generator.integers(...devices, true);
    const amounts = [...cells].map((_, k) => (k < count ? generator.uniform(...data) : 0));
    const dataInitial = Float32Array.from(amounts);
    return {
      uavCell: this.landing[generator.integers(0, this.landing.length)],
      timeLeft: generator.integers(...flying_time, true),
      deviceCells: Int16Array.from(cells),
      dataInitial,
      dataLeft: dataInitial,
      landed: false,
    };
  }

  /** A step of every environment, and an update once the memory is prefilled; see training.py. */
  step() {
    const { dials, environment, generator, states } = this;
    const actions = this.act();
    const prices = { ...REWARDS, movement: dials.movement_reward, crash: this.crashReward };
    const steps = states.map((state, k) =>
      environment.transition(state, actions[k], environment.drawFading(state, generator)),
    );
    const rewards = steps.map(({ outcome }) => reward(outcome, prices));
    const ends = steps.map(({ outcome }) => Number(outcome.landed) + 2 * Number(outcome.crashed));
    this.replay.add(states, actions, rewards, ends);
    this.states = steps.map(({ state }) => (ended(state) ? this.start(generator) : state));
    const count = this.replay.count(dials);
    if (count >= Math.max(this.prefill, dials.batch_size)) this.update();
    this.steps += dials.environments;
    const interval = Math.max(Math.floor(dials.steps / POINTS), LEAST);
    const due =
      Math.floor(this.steps / interval) > Math.floor((this.steps - dials.environments) / interval);
    return due || this.finished ? this.measure() : null;
  }

  /** Actions of the softmax policy (eq. 10), random ones until the memory is prefilled. */
  act() {
    const { dials, generator, states, temperature, online } = this;
    if (this.replay.count(dials) < this.prefill)
      return states.map(() => generator.integers(0, ACTIONS.length));
    const [values] = this.valuesOf([online], states);
    return states.map((_, row) => {
      const [begin, likely] = [row * ACTIONS.length, best(values, row)];
      const weights = ACTIONS.map((_, action) =>
        Math.exp((values[begin + action] - values[begin + likely]) / temperature),
      );
      let left = generator.random() * sum(weights);
      const action = weights.findIndex((weight) => (left -= weight) < 0);
      return action < 0 ? likely : action; // rounded, the weights may add up to less
    });
  }

  /** What the network sees of a state. */
  mapOf(state) {
    return viewsOf(this.observation.map(state), this.observation.width, this.dials)[0][0];
  }

  /** Q-values of states by some networks, (n, 6) each. */
  valuesOf(networks, states) {
    states.forEach((state, row) => {
      const map = this.mapOf(state);
      this.maps.set(map, row * map.length);
      this.times[row] = state.timeLeft / this.dials.time_scale;
    });
    return networks.map((network) => network.forward([this.maps], this.times, states.length));
  }

  /** One gradient step towards the targets (eq. 7, 8), and one of the target; see ddqn.py. */
  update(batch = null) {
    const { dials, online, target, slopes } = this;
    batch ??= this.replay.sample(dials.batch_size, dials, this.generator, this.states);
    const [goals, states] = [this.targets(batch), batch.map(({ state }) => state)];
    const [values] = this.valuesOf([online], states);
    slopes.fill(0);
    let loss = 0;
    batch.forEach(({ action }, row) => {
      const at = row * ACTIONS.length + action;
      const error = values[at] - goals[row];
      loss += error ** 2 / batch.length;
      slopes[at] = (2 * error) / batch.length;
    });
    online.backward(slopes, batch.length);
    online.descend(this.learningRate, dials.amsgrad);
    if (!dials.frozen) target.follow(online, dials.target_update_rate);
    this.losses.push(loss);
    this.updates += 1;
  }

  /** y = r + γ Q_target(s', a), a the best by the online network or, single, the target (eq. 8). */
  targets(batch) {
    const next = batch.map((each) => each.next);
    const { dials, target, online } = this;
    const [values, choice] = this.valuesOf([target, dials.double ? online : target], next);
    return batch.map(({ reward, discount }, row) => {
      return reward + discount * values[row * ACTIONS.length + best(choice, row)];
    });
  }

  /** The next point of the curves. @returns {Point} */
  measure() {
    const flights = this.fly(this.missions);
    const mean = (values) => sum(values) / values.length;
    const shares = flights.map(({ state }) => 1 - sum(state.dataLeft) / sum(state.dataInitial));
    const landed = flights.map(({ state }) => Number(state.landed));
    const point = {
      steps: this.steps,
      landed: mean(landed),
      collected: mean(shares),
      home: mean(shares.map((share, k) => share * landed[k])),
      return: mean(flights.map((flight) => flight.return)),
      loss: this.losses.length ? mean(this.losses) : null,
    };
    this.losses = [];
    this.points.push(point);
    return point;
  }

  /** How the agent of now flies by its greedy policy (eq. 9): last states and returns. */
  fly(starts) {
    const generator = new Portable(Use.FADING, 0);
    const flights = starts.map((state) => ({ state, return: 0 }));
    for (let left = flights; left.length; left = left.filter(({ state }) => !ended(state))) {
      const states = left.map(({ state }) => state);
      const [values] = this.valuesOf([this.online], states);
      left.forEach((flight, row) => {
        const fading = this.environment.drawFading(flight.state, generator);
        const action = best(values, row);
        const { state, outcome } = this.environment.transition(flight.state, action, fading);
        Object.assign(flight, { state, return: flight.return + reward(outcome) });
      });
    }
    return flights;
  }
}
