// Who flies, and the flights of one mission, each flown once.

import { hiddenRows } from "./channel.js";
import { Greedy, Random } from "./pilots.js";
import { ACTIONS, Environment, HandFlight, kept, sum } from "./world.js";
import { LETTERS, YOU } from "./state.js";

/**
 * @typedef {import("./world.js").Trajectory & { values?: Float32Array[] }} Flight
 *   with the Q-values or scores before each step, where an agent flew
 * @typedef {import("./words.js").Who} Who
 */

/** How a policy is called. @param {Object<string, Who>} agents by name @returns {Who} */
export function whoIs(name, agents) {
  if (name === YOU) return { name, title: "you", subject: "you", you: true };
  const { title = name, subject = name } = agents[name] ?? {};
  return { name, title, subject, you: false };
}

/** The flights of one mission, each flown when it is first asked for. */
export class Hangar {
  /** @param {Hangar | null} before its environment serves again if the city is the same */
  constructor(mission, agents, before = null) {
    const same = before && before.mission.city === mission.city;
    this.environment = same ? before.environment : new Environment(mission.city);
    this.pilots = same ? before.pilots : new Map();
    Object.assign(this, { mission, agents, flown: new Map() });
  }

  /** @returns {Flight} of a policy, or that by hand, as far as it has come */
  flight(policy, letters = "") {
    const key = policy === YOU ? `${YOU} ${letters}` : policy;
    return kept(this.flown, key, () => this.fly(this.mission, policy, letters));
  }

  /** @returns {Flight} of any mission over this city; `first` are actions with which it begins */
  fly(mission, policy, letters = "", first = []) {
    const flight = new HandFlight(this.environment, mission);
    const hand = policy === YOU ? [...letters].map((letter) => LETTERS.indexOf(letter)) : first;
    for (const action of hand) if (!flight.ended) flight.step(action);
    if (policy === YOU) return flight.trajectory;
    const pilot = policy === "random" ? new Random(mission.seed) : this.pilot(policy);
    const values = [];
    while (!flight.ended) {
      if (pilot.qValues) values.push(pilot.qValues(flight.state));
      flight.step(pilot.qValues ? bestOf(values.at(-1)) : pilot.act(flight.state));
    }
    return { ...flight.trajectory, ...(pilot.qValues && { values }) };
  }

  /** Forgets what an agent of this name flew, because another has its name now. */
  forget(name) {
    this.flown.delete(name);
    this.pilots.delete(name);
  }

  pilot(name) {
    const { agents, environment } = this;
    const make = () => agents[name]?.agent.over(environment) ?? new Greedy(environment);
    return kept(this.pilots, name, make);
  }
}

const bestOf = (values) => values.indexOf(Math.max(...values));

/** How a flight went: data units and their share, steps and the share of the time, the return. */
export function numbers(flight) {
  const [data, left] = [flight.dataLeft[0], flight.dataLeft.at(-1)].map(sum);
  const steps = flight.action.length;
  return {
    landed: flight.landed,
    ended: flight.landed || flight.timeLeft.at(-1) <= 0,
    collected: data - left,
    share: (data - left) / data,
    steps,
    timeLeft: flight.timeLeft.at(-1),
    timeUsed: steps / flight.timeLeft[0],
    return: sum(flight.reward),
  };
}

/**
 * What player.js draws; see `film` in player.py.
 * @param {[string, Flight][]} flights with titles
 * @param {string[]} colours of the devices
 * @param {Object<number, [number, number]>} moved where some devices are shown instead
 */
export function filmOf({ mission, environment }, flights, colours, moved = {}) {
  const { city } = mission;
  const devices = mission.devices.map((cell, k) => moved[k] ?? cell);
  return {
    title: `Flight${flights.length > 1 ? "s" : ""} over ${city.name}`,
    city: city.rows,
    devices: devices.map((cell, number) => ({
      number,
      cell,
      colour: colours[number % colours.length],
      hidden: hiddenRows(environment, cell),
    })),
    flights: flights.map(([name, flight]) => ({ name, ...filmedFlight(flight, mission) })),
  };
}

function filmedFlight(flight, { city, devices, flyingTime }) {
  const { landed, collected, steps, ended: over } = numbers(flight);
  const end = landed ? "landed" : over ? "crashed" : "in the air";
  const how = end === "crashed" ? ", because the time ran out," : "";
  const what = { landed: "Landed", crashed: "Crashed", "in the air": "In the air" }[end];
  const all = sum(flight.dataLeft[0]);
  return {
    end,
    ending: `${what}${how} after ${steps} of ${flyingTime} units of time, with ${collected.toFixed(1)} of ${all.toFixed(1)} units of data.`,
    path: flight.uavCell.map((cell) => city.position(cell)),
    left: flight.dataLeft.map((left, k) => [...left.slice(0, devices.length), flight.timeLeft[k]]),
    refused: flight.action.map((action, k) => (flight.intervened[k] ? ACTIONS[action] : "")),
  };
}
