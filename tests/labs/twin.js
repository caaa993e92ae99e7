// What the JavaScript twins answer to what test_world.py asks.

import { readAgent } from "../../uavdh_lite/labs/checkpoint.js";
import { Greedy, Random } from "../../uavdh_lite/labs/pilots.js";
import {
  City,
  Environment,
  HandFlight,
  Mission,
  lineOfSight,
  reward,
  safeActions,
  setChannel,
} from "../../uavdh_lite/labs/world.js";

const bytesOf = (base64) => new Uint8Array(Buffer.from(base64, "base64"));

export const stateOf = ({ uav_cell, time_left, device_cells, data_initial, data_left }) => ({
  uavCell: uav_cell,
  timeLeft: time_left,
  deviceCells: Int16Array.from(device_cells),
  dataInitial: Float32Array.from(data_initial),
  dataLeft: Float32Array.from(data_left),
  landed: false,
});

export function answer({ channel, cities, states, sight, agents, missions }) {
  setChannel(channel);
  const places = cities.map(
    ({ name, rows }) => new Environment(City.fromText(name, rows.join("\n"))),
  );
  const stepped = states.map(({ city, action, fading, ...values }) => {
    const [environment, state] = [places[city], stateOf(values)];
    const draws = Float32Array.from(fading);
    const { state: after, outcome } = environment.transition(state, action, draws);
    return {
      uav_cell: after.uavCell,
      time_left: after.timeLeft,
      data_left: [...after.dataLeft],
      landed: after.landed,
      served: [...outcome.served],
      uploaded: [...outcome.uploaded],
      intervened: outcome.intervened,
      crashed: outcome.crashed,
      reward: reward(outcome),
      snr_db: [...environment.snrDb(state, after.uavCell, draws)],
      allowed: environment.allowedActions(state),
      safe: safeActions(environment, state),
      greedy: new Greedy(environment).act(state),
      way_home: environment.wayHome[state.uavCell],
    };
  });
  const seen = sight.map((number) => {
    const { city, size, cells } = places[number];
    const from = (_, cell) => lineOfSight(city.buildings, size, cell).join("");
    return Array.from({ length: cells }, from).join("");
  });
  const valued = agents.map(({ base64, city, asked }) => {
    const flier = readAgent(bytesOf(base64)).over(places[city]);
    return asked.map((values) => [...flier.qValues(stateOf(values))]); // in JSON −∞ is null
  });
  const flown = missions.map(({ scenario, city, seed }) => {
    const mission = Mission.draw(scenario, places[city].city, seed);
    const [flight, { action: random }] = [new Greedy(places[city]), new Random(seed)].map(
      (pilot) => {
        const hand = new HandFlight(places[city], mission);
        while (!hand.ended) hand.step(pilot.act(hand.state));
        return hand.trajectory;
      },
    );
    const { action, reward } = flight;
    return { mission: mission.asJson(), action, reward, random, left: [...flight.dataLeft.at(-1)] };
  });
  return { stepped, seen, valued, flown };
}
