// Who flies, and the flights of one mission, each flown once.

import { hiddenRows } from "./channel.js";
import { Greedy, Random, bytesOf } from "./pilots.js";
import { ACTIONS, Environment, HandFlight, MeasuredEnvironment, kept, rate, sum } from "./world.js";
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
  return { name, title, subject, you: false, thinks: name in agents };
}

/** The flights of one mission, each flown when it is first asked for. */
export class Hangar {
  /**
   * @param {object[]} places the real places, each with rows and table
   * @param {Hangar | null} before its environment serves again if the city is the same
   */
  constructor(mission, agents, places, before = null) {
    const { city } = mission;
    const same = before && before.mission.city === city;
    /** The real place that the city is, null if it is none. */
    this.place = places.find(({ rows }) => rows.join() === city.rows.join()) ?? null;
    this.environment = same ? before.environment : environmentOf(city, this.place);
    this.pilots = same ? before.pilots : new Map();
    Object.assign(this, { mission, agents, flown: new Map() });
  }

  /** @returns {Flight} of a policy, or that by hand, as far as it has come */
  flight(policy, letters = "") {
    const key = policy === YOU ? `${YOU} ${letters}` : policy;
    return kept(this.flown, key, () => this.fly(this.mission, policy, letters));
  }

  /** @returns {Flight} of any mission over this city */
  fly(mission, policy, letters = "") {
    const flight = new HandFlight(this.environment, mission);
    if (policy === YOU) {
      for (const letter of letters) if (!flight.ended) flight.step(LETTERS.indexOf(letter));
      return flight.trajectory;
    }
    const pilot = policy === "random" ? new Random(mission.seed) : this.pilot(policy);
    if (!pilot.qValues) return mission.fly(this.environment, pilot);
    const values = [];
    while (!flight.ended) {
      values.push(pilot.qValues(flight.state));
      flight.step(values.at(-1).indexOf(Math.max(...values.at(-1))));
    }
    return { ...flight.trajectory, values };
  }

  pilot(name) {
    const { agents, environment } = this;
    return kept(
      this.pilots,
      name,
      () => agents[name]?.agent.over(environment) ?? new Greedy(environment),
    );
  }
}

function environmentOf(city, place) {
  return place
    ? new MeasuredEnvironment(city, bytesOf(place.gain), place.level_db)
    : new Environment(city);
}

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
 * What player.js draws; see `film` in player.py. `traced`: what is heard is that of traced rays.
 * @param {[string, Flight][]} flights with titles
 * @param {string[]} colours of the devices
 */
export function filmOf({ mission, environment }, flights, colours) {
  const { city, devices } = mission;
  return {
    title: `Flight${flights.length > 1 ? "s" : ""} over ${city.name}`,
    city: city.rows,
    traced: Boolean(environment.meanSnrDb),
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

/**
 * What is wrong with a mission, as facts: cells that no way leads to, a device that cannot be heard
 * well, too little time.
 * @param {Environment} environment
 */
export function warnings(environment, { city, start, devices, data, flyingTime }) {
  const sealed = [...city.kinds.keys()].filter(
    (cell) => !city.noFly[cell] && city.landingDistance[cell] < 0,
  );
  const reached = (cell) => city.landingDistance[cell] >= 0;
  const bestOf = (snrs) => {
    const best = [...snrs.keys()]
      .filter(reached)
      .reduce((one, other) => (snrs[other] > snrs[one] ? other : one));
    return { amount: rate(snrs[best]), where: city.position(best) };
  };
  const facts = [];
  if (sealed.length)
    facts.push({ kind: "sealed", cells: sealed.length, where: city.position(sealed[0]) });
  devices.forEach((position, device) => {
    const cell = city.cell(position);
    if (!environment.isSeen(cell))
      facts.push({
        kind: "unheard",
        device,
        traced: environment.meanSnrDb ? bestOf(environment.tracedSnrs(cell)) : null,
      });
    else if (!city.noFly[cell] && !reached(cell)) facts.push({ kind: "unreachable", device });
  });
  if (!city.landing[city.cell(start)]) facts.push({ kind: "outside" });
  const home = environment.timeToLand[city.cell(start)];
  const bare = [...data.keys()].filter((device) => !data[device]);
  if (bare.length) facts.push({ kind: "bare", devices: bare });
  if (home >= flyingTime) facts.push({ kind: "late", time: flyingTime, home });
  return facts;
}
