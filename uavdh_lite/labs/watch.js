// The tool Watch: recorded trainings, drawn as curves whose points fly.

import { escaped } from "../player.js";
import { button, chooser } from "./html.js";
import { METRICS } from "./state.js";
import { RUNS, grouped, upper } from "./words.js";

const explained = escaped;
export const WATCH = {
  title: "Watch",
  still: ({ state }) => !state.point,
  html({ panel, film, state: { looks, point } }) {
    const { settings, runs, says, village, elsewhere, left, mean } = panel;
    const others = (k) =>
      settings.map(([title], run) => [run, title]).filter(([run]) => run !== looks.runs[1 - k]);
    const racer = (colour, pairs, k) => `<span class="racer"><span class="key ${colour}"></span>
        ${chooser(colour, `run-${k}`, pairs, looks.runs[k] ?? "")}</span>`;
    const about = looks.runs.map((run, k) => `${upper(RUNS[k])}: ${escaped(settings[run][1])}`);
    const [flight] = film.flights;
    const said = ({ text, run, at }) =>
      at.reduce((html, k) => {
        // each point that it names flies its agent
        const steps = grouped(runs[run].points[k].steps);
        return html.replace(
          steps,
          button(
            steps,
            { kind: "race", point: [run, k] },
            'class="inline" title="see its agent fly"',
          ),
        );
      }, escaped(text));
    const verdict = `<p class="verdict" role="status">${[says.at(-1), ...says.slice(0, -1)].map(said).join("<br>")}</p>`; // how it ended first
    const odd = runs.flatMap(({ points }) => points).find(({ steps }) => steps % 1000);
    return `<h2>Watch it learn in the ${escaped(village)}</h2><div class="row">${racer("blue", others(0), 0)}${racer("orange", [["", "nobody"], ...others(1)], 1)}
        ${chooser(
          "shown",
          "metric",
          METRICS.map((each) => [each, each.replaceAll("_", " ")]),
          looks.metric,
        )}</div>
        <p class="setting">${about.join("<br>")}</p>
        <div class="${this.fresh(looks.runs) ? "draws" : ""}">${curves(runs, point, looks.metric)}</div>
        <p class="flies">${
          point
            ? `This flight: ${explained(flight.name)}, in one mission. ${flight.ending} ${mean}`
            : `Press near a point, or move with the arrow keys, to see its agent fly${elsewhere ? ` in the ${escaped(village)}; until then the map shows your mission` : ""}.`
        }
        ${left ? "↶ brings your mission back." : ""}</p>${verdict}
        <p>${point ? "" : "Each point stands for 100 missions that the agent did not learn from."}
        The training runs were recorded.
        ${odd ? `They fly several missions at once, hence ${grouped(odd.steps)} steps and not ${grouped(odd.steps - (odd.steps % 1000))}.` : ""}</p>`;
  },
  drawn: "", // the runs whose curves have drawn themselves
  fresh(runs) {
    const before = this.drawn;
    this.drawn = String(runs);
    return before !== this.drawn;
  },
  /** Keys over the curves go from point to point, and from run to run. */
  keyed(
    {
      scene: {
        panel: { runs },
        state: { point },
      },
      ask,
    },
    key,
    down = 0,
    right = { Home: -Infinity, End: Infinity }[key],
  ) {
    if (right === undefined) return null;
    const [run, k] = point ?? [0, right > 0 ? -1 : runs[0].points.length];
    const other = Math.min(Math.max(run + down, 0), runs.length - 1);
    const there = Math.min(Math.max(k + right, 0), runs[other].points.length - 1);
    return () => ask({ kind: "race", point: [other, there] });
  },
};

/** The curves of a race: points by steps; full blue lies on a wider, open orange. Arrow keys choose a point. */
function curves(runs, point, metric) {
  const [width, height, left, bottom] = [420, 195, 44, 26];
  const steps = Math.max(...runs.map(({ points }) => points.at(-1).steps));
  const x = (each) => left + ((width - left - 12) * each) / steps;
  const y = (share) => 10 + (height - bottom - 10) * (1 - share);
  const name = (share) => `${Math.round(100 * share)} %`;
  const ticks = [0, 0.5, 1].map(
    (tick) =>
      `<path class="grid" d="M${left} ${y(tick)}H${width - 12}"/><text x="${left - 6}" y="${y(tick)}">${name(tick)}</text>`,
  );
  const times = [0, 0.25, 0.5].map(
    (part) =>
      `<text class="time" x="${x(part * steps)}" y="${height - 8}">${grouped(Math.round(part * steps))}</text>`,
  );
  const about = (run, k) =>
    `${RUNS[run]}, ${runs[run].title}, after ${grouped(runs[run].points[k].steps)} steps: ${name(runs[run].points[k][metric])}`;
  const drawn = ({ points, kink }, run) => {
    const here =
      kink === null
        ? ""
        : `<path class="kink" d="M${x(points[kink].steps)} 4V${height - bottom}"/>`;
    const d = points
      .map((each, k) => `${k ? "L" : "M"}${x(each.steps)} ${y(each[metric])}`)
      .join("");
    const dot = (each, k) => {
      const on = point?.[0] === run && point[1] === k ? "on" : "";
      const ask = escaped(JSON.stringify({ kind: "race", point: [run, k] }));
      return `<circle class="dot ${on}" cx="${x(each.steps)}" cy="${y(each[metric])}" r="${3.5 + 2 * run}" data-ask="${ask}"
        ><title>${about(run, k)}</title></circle>`;
    };
    return `<g class="${RUNS[run]}">${here}<path class="curve" d="${d}" pathLength="1"/>${points.map(dot).join("")}</g>`;
  };
  const told = point ? about(...point) : "no point chosen";
  return `<svg class="curves" viewBox="0 0 ${width} ${height}" role="slider" tabindex="0" aria-label="points of the curves; up and down: the other curve"
    aria-valuemin="1" aria-valuemax="${runs[0].points.length}" aria-valuenow="${point ? point[1] + 1 : 1}" aria-valuetext="${escaped(told)}">
    ${ticks.join("")}${times.join("")}<text x="${width - 12}" y="${height - 8}">${grouped(steps)} steps</text>
    ${runs.map(drawn).reverse().join("")}</svg>`;
}
