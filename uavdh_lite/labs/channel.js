// The radio link of one device to every cell, without fading: the ledger of the tool Channel.

import { CHANNEL, pathLossDb, rate } from "./world.js";

/**
 * What becomes of the signal on its way to each cell; lists are by the cell's number.
 *
 * | entry | meaning |
 * | --- | --- |
 * | `transmit` | the SNR at a distance of 1 m, dB |
 * | `distance` | from the device to a UAV over the cell, m |
 * | `pathLoss` | with a line of sight, dB |
 * | `building` | what the buildings in between cost, dB; 0 with a line of sight |
 * | `snr` | what is left, dB |
 * | `rate`, `free` | data units a slot, and what they would be with a line of sight |
 * | `dearest` | the cell over which a building costs most data |
 * | `range` | SNRs over this city from the weakest to the strongest, in steps of 10 dB |
 * | `traced` | over a real place, the SNRs and rates that flights have; null elsewhere |
 * | `fading` | its standard deviation without a line of sight and with one, dB |
 * @param {import("./world.js").Environment} environment
 * @param {[number, number]} device row and column
 */
export function ledger(environment, device) {
  const { city, size, transmitSnrDb: transmit } = environment;
  const [[row, col], from] = [device, city.cell(device)];
  const squared = (down, right) =>
    (down ** 2 + right ** 2) * CHANNEL.cellSize ** 2 + CHANNEL.altitude ** 2;
  const far = Array.from(city.kinds, (_, cell) => {
    const [r, c] = city.position(cell);
    return squared(r - row, c - col);
  });
  const pathLoss = far.map((each) => pathLossDb(each, 1));
  const snr = Array.from(environment.snrMap(from));
  const rates = Array.from(environment.rateMap(from));
  const free = pathLoss.map((loss) => rate(transmit - loss));
  const lost = free.map((each, cell) => (city.noFly[cell] ? -1 : each - rates[cell]));
  const traced = environment.meanSnrDb ? Array.from(environment.tracedSnrs(from)) : null;
  const weakest = transmit - pathLossDb(squared(size - 1, size - 1), 0);
  const strongest = transmit - pathLossDb(squared(0, 0), 1);
  return {
    transmit,
    distance: far.map(Math.sqrt),
    pathLoss,
    building: snr.map((left, cell) => transmit - pathLoss[cell] - left),
    snr,
    rate: rates,
    free,
    dearest: city.position(lost.indexOf(Math.max(...lost))),
    range: [10 * Math.floor(weakest / 10), 10 * Math.ceil(strongest / 10)],
    traced: traced && { snr: traced, rate: traced.map(rate) },
    fading: CHANNEL.fadingVariance.map(Math.sqrt),
  };
}

/** For each row of the city, `#` where a device in this cell is out of sight; none on a building. */
export function hiddenRows(environment, position) {
  const { city, size } = environment;
  const cell = city.cell(position);
  if (city.buildings[cell]) return [];
  const signs = Array.from(environment.sight(cell), (seen) => (seen ? "." : "#")).join("");
  return city.rows.map((_, r) => signs.slice(r * size, (r + 1) * size));
}
