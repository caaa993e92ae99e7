// The radio link of one device to every cell, without fading, as a ledger.

import { KINDS } from "../player.js";
import { button, colourOf, heat, ramp } from "./html.js";
import { signed, units } from "./words.js";
import { CHANNEL, pathLossDb, rate } from "./world.js";

/**
 * What becomes of the signal on its way to each cell, by the cell's number: distance, SNR and losses,
 * and the data units a slot, with the buildings (`rate`) and without (`free`).
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
  const weakest = transmit - pathLossDb(squared(size - 1, size - 1), 0);
  const strongest = transmit - pathLossDb(squared(0, 0), 1);
  return {
    transmit, // the SNR at a distance of 1 m, dB
    distance: far.map(Math.sqrt),
    pathLoss, // with a line of sight, dB
    building: snr.map((left, cell) => transmit - pathLoss[cell] - left),
    snr,
    rate: rates,
    free,
    dearest: city.position(lost.indexOf(Math.max(...lost))),
    range: [10 * Math.floor(weakest / 10), 10 * Math.ceil(strongest / 10)],
    fading: CHANNEL.fadingVariance.map(Math.sqrt),
  };
}

/** Rows of the city, `#` where a device in this cell is out of sight; none on a building. */
export function hiddenRows(environment, position) {
  const { city, size } = environment;
  const cell = city.cell(position);
  if (city.buildings[cell]) return [];
  const signs = Array.from(environment.sight(cell), (seen) => (seen ? "." : "#")).join("");
  return city.rows.map((_, r) => signs.slice(r * size, (r + 1) * size));
}

const tenths = (value) => Number(value.toFixed(1));

export const CHANNEL_TOOL = {
  title: "Channel",
  words: ["slot", "SNR", "SNR at 1 m", "path loss", "hidden by buildings", "fading"],
  still: () => true,
  cursor: "arrow keys move the cell that the UAV is over; Enter on a device chooses it",
  html({ panel, state }) {
    const [low, high] = panel.range.map((each) => `${each} dB`.replace("-", "−"));
    const device = (_, k) =>
      button(`device ${k}`, { kind: "look", device: k }, `aria-pressed="${k === panel.device}"`);
    return `<h2 class="sentence" aria-live="polite"></h2><div class="row">${state.devices.map(device).join("")}</div>
      <table class="ledger"></table>
      ${ramp(low, high, `SNR over each cell. Point at one.`)}`;
  },
  under({ film, panel }) {
    const [low, high] = panel.range;
    return heat(panel.snr, film.city.length, (snr) => colourOf((snr - low) / (high - low)), 0.9);
  },
  over: () => '<path class="ray"/>',
  point(stage, { panel, state, film }, pointed) {
    if (pointed || this.city !== String(film.city))
      [this.cell, this.city] = [pointed, String(film.city)]; // the last one stays
    const [row, col] = this.cell ?? panel.dearest;
    const number = row * film.city.length + col;
    const [y, x] = state.devices[panel.device].cell;
    const cost = panel.building[number];
    const hidden = cost > 1e-6;
    stage.find(".ray")?.setAttribute("d", `M${x} ${y}L${col} ${row}`);
    stage.find(".ray")?.classList.toggle("blocked", hidden);
    const instead = hidden ? `, ${units(panel.free[number])} without buildings` : ", in sight";
    const there = KINDS[film.city[row][col]]?.name.split(":")[0] ?? "open ground";
    const where = `<small>over row ${row}, column ${col}, ${there}</small>`;
    stage.fill(".sentence", `${units(panel.rate[number])} units a slot${instead} ${where}`);
    const entry = ([name, value]) => `<tr><th scope="row">${name}</th><td>${value} dB</td></tr>`;
    const [start, loss] = [panel.transmit, panel.pathLoss[number]];
    const lines = [
      ["SNR at 1 m", signed(start)],
      [`path loss over ${panel.distance[number].toFixed(0)} m`, `−${signed(loss)}`],
      ["hidden by buildings", hidden ? `−${signed(cost)}` : "0.0"],
      ["SNR", signed(tenths(start) - tenths(loss) - tenths(cost))], // adds up as it is shown
      ["fading", `± ${panel.fading[Number(!hidden)].toFixed(1)}`],
    ];
    stage.fill(".ledger", lines.map(entry).join(""));
  },
};
