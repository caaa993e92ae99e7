// What the JavaScript twins answer to what test_world.py asks.

import * as pilots from "../../uavdh_lite/labs/pilots.js";
import * as world from "../../uavdh_lite/labs/world.js";

export function answer({ cities, states, sight, agents, missions, numbers }) {
  const places = cities.map(({ name, rows }) => {
    const city = world.City.fromText(name, rows.join("\n"));
    return new world.SafeEnvironment(city);
  });
  const stateOf = ({ uav_cell, time_left, device_cells, data_initial, data_left }) => ({
    uavCell: uav_cell,
    timeLeft: time_left,
    deviceCells: Int16Array.from(device_cells),
    dataInitial: Float32Array.from(data_initial),
    dataLeft: Float32Array.from(data_left),
    landed: false,
  });
  const stepped = states.map(({ city, action, fading, ...values }) => {
    const [environment, state] = [places[city], stateOf(values)];
    const plain = world.Environment.prototype;
    const taken = [state, action, Float32Array.from(fading)];
    const { state: after, outcome } = plain.transition.apply(environment, taken);
    return {
      uav_cell: after.uavCell,
      time_left: after.timeLeft,
      data_left: [...after.dataLeft],
      landed: after.landed,
      served: [...outcome.served],
      uploaded: [...outcome.uploaded],
      intervened: outcome.intervened,
      crashed: outcome.crashed,
      reward: world.reward(outcome),
      snr_db: [...environment.snrDb(state, after.uavCell, taken[2])],
      allowed: plain.allowedActions.call(environment, state),
      safe: environment.allowedActions(state),
      sent_home: environment.transition(...taken).outcome.sentHome,
      greedy: new pilots.Greedy(environment).act(state),
      way_home: environment.wayHome[state.uavCell],
    };
  });
  const seen = sight.map((number) => {
    const { city, size, cells } = places[number];
    const from = (_, cell) => world.lineOfSight(city.buildings, size, cell).join("");
    return Array.from({ length: cells }, from).join("");
  });
  const valued = agents.map(({ base64, city, asked }) => {
    const flier = pilots.readAgent(pilots.bytesOf(base64)).over(places[city]);
    return asked.map((values) => [...flier.qValues(stateOf(values))]); // in JSON −∞ is null
  });
  const flown = missions.map(({ scenario, city, seed }) => {
    const mission = world.Mission.draw(scenario, places[city].city, seed);
    const flight = mission.fly(places[city], new pilots.Greedy(places[city]));
    const { action, reward } = flight;
    return { mission: mission.asJson(), action, reward, left: [...flight.dataLeft.at(-1)] };
  });
  const generator = new world.Portable(world.Use.FADING, numbers.seed);
  const drawn = Array.from({ length: numbers.count }, () => [
    generator.random(),
    generator.integers(3, 9),
    generator.standardNormal(),
  ]);
  return { stepped, seen, valued, flown, drawn };
}
