// Draws flights and plays them, from what `film` in player.py makes. On the map a cell is 1 wide, x
// is the column and y the row. Time is counted in steps: at 3.5 the UAV is half-way from its cell
// after 3 steps to that after 4.
const SPEED = 4; // steps a second
const MUCH = 4; // data units in a step; more of them make nothing wider
export const SQUARE = "h1v1h-1z"; // like the hatches, from a cell's north-west corner
export const KINDS = {
  L: { name: "start and landing zone", hatch: "m0 .5l.5 .5m-.5 -1l1 1m-.5 -1l.5 .5" },
  b: {
    name: "low building: may be flown over",
    hatch: "m.25 .25h.01m.49 0h.01m-.01 .5h.01m-.51 0h.01",
  },
  B: { name: "tall building", hatch: "" },
  N: { name: "no-fly zone", hatch: "m0 .5l.5 -.5m-.5 1l1 -1m-.5 1l.5 -.5" },
};
// The marks of plotting.py
const CROSS =
  '<path d="M-.5 -.25l.25 -.25L0 -.25 .25 -.5l.25 .25L.25 0l.25 .25-.25 .25L0 .25-.25 .5l-.25 -.25L-.25 0z"/>';
const START = '<path class="start" d="M0 -.36L.36 .28H-.36z"/>';
const LANDED = '<path class="landed" d="M0 -.42L.42 0 0 .42 -.42 0z"/>';
const CRASHED = `<path class="crashed" d="M0 -.5L.12 -.16 .48 -.15 .19 .06 .29 .4 0 .2 -.29 .4 -.19 .06 -.48 -.15 -.12 -.16z"/>`;
const rotor = (turn) => `<circle cx=".34" r=".14" transform="rotate(${turn})"/>`;
const ROTORS = [45, 135, 225, 315].map(rotor).join("");
export const UAV = `<path d="M-.24 -.24l.48 .48m0 -.48-.48 .48"/>${ROTORS}`;

// Draws what a page has for each player that is not drawn yet.
export function drawAll() {
  for (const source of document.querySelectorAll(".uavdh-player > script")) {
    draw(source.parentNode, JSON.parse(source.textContent));
  }
}

// Draws a film in place of what is in `root`.
function draw(root, film) {
  root.innerHTML = wholeStage(film);
  const clock = playback(root.firstChild, showing(root.querySelector(".flights"), film));
  clock.load(lastStep(film));
}

export const lastStep = (film) => Math.max(...film.flights.map((flight) => flight.path.length - 1));

// What shows a moment of all flights, whose panels are in `root`, and returns them in words.
export function showing(root, film) {
  const panels = root.querySelectorAll(".flight");
  const flights = film.flights.map((flight, k) => shower(panels[k], film, flight));
  let pointed = null; // the index of a device
  let shown = [0, false];
  const update = (...now) => {
    shown = now;
    return flights.map((flight) => flight(now[0], pointed, now[1]));
  };
  const point = ({ type, target, relatedTarget }) => {
    const device = (type === "focusout" ? relatedTarget : target)?.closest?.("[data-device]");
    pointed = device ? Number(device.dataset.device) : null;
    update(...shown);
  };
  for (const type of ["pointerover", "pointerleave", "focusin", "focusout"]) {
    root.addEventListener(type, point);
  }
  return update;
}

// Connects the controls in `stage`. `update` shows a moment: the time, and whether it plays.
// Returns `load(last, time, playing)`, for a film with so many steps, and `show(time, playing)`.
export function playback(stage, update) {
  const find = (selector) => stage.querySelector(`.controls ${selector}`);
  const [button, slider, counter, speed] = [".play", "input", "output", "select"].map(find);
  const calm = matchMedia("(prefers-reduced-motion: reduce)");
  let [time, last] = [0, 0];
  let before = null; // when the last frame was drawn, ms; null while paused
  speed.value = 1;

  function draw() {
    const now = before !== null && calm.matches ? Math.floor(time) : time;
    const texts = update(now, before !== null);
    slider.value = now;
    counter.textContent = `${Math.ceil(now)} of ${last}`;
    slider.setAttribute("aria-valuetext", `step ${counter.textContent}. ${texts.join(" ")}`);
    button.textContent = before === null ? "Play" : "Pause";
  }

  function show(step, playing = false) {
    time = Math.min(Math.max(step, 0), last);
    const begins = playing && before === null;
    before = playing ? performance.now() : null;
    draw();
    if (begins) requestAnimationFrame(frame);
  }

  function frame(now) {
    if (before === null || !stage.isConnected) return;
    const seconds = Math.min(Math.max(now - before, 0), 100) / 1000; // the page may have slept
    before = now;
    time += SPEED * speed.value * seconds;
    if (time >= last) return show(last);
    draw();
    requestAnimationFrame(frame);
  }

  const keys = {
    " ": () => show(time < last || before !== null ? time : 0, before === null),
    ArrowLeft: () => show(Math.ceil(time) - 1),
    ArrowRight: () => show(Math.floor(time) + 1),
    Home: () => show(0),
    End: () => show(last),
  };
  // Before the page around hears of a key: in a notebook, most of them edit it
  function hear(event) {
    if (!stage.isConnected) return window.removeEventListener("keydown", hear, true);
    if (!stage.contains(event.target)) return;
    if (event.key !== "Tab") event.stopPropagation();
    const own = event.key === " " ? "button, select, input" : "select, input";
    const other = event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented;
    if (!keys[event.key] || other) return;
    if (event.target !== slider && event.target.matches(own)) return; // it takes the key itself
    event.preventDefault();
    keys[event.key]();
  }
  window.addEventListener("keydown", hear, true);
  button.addEventListener("click", keys[" "]);
  find(".back").addEventListener("click", keys.ArrowLeft);
  find(".forward").addEventListener("click", keys.ArrowRight);
  slider.addEventListener("input", () => show(Number(slider.value)));
  return {
    show,
    load(steps, at = steps, playing = false) {
      slider.max = last = steps;
      show(at, playing);
    },
    get now() {
      return { time, last, playing: before !== null };
    },
  };
}

// A flight at a moment: where the UAV is, what is left of each device's data and of the time, and
// what each device uploads in the step that is being flown.
export function momentAt({ path, left }, time) {
  const now = Math.min(time, path.length - 1);
  const step = Math.ceil(now);
  const from = Math.max(step - 1, 0);
  const between = (one, other) => one.map((each, k) => each + (now - from) * (other[k] - each));
  const uploads = left[from].map((each, k) => each - left[step][k]).slice(0, -1);
  const most = Math.max(...uploads);
  const served = most > 0 ? uploads.indexOf(most) : null;
  const [place, amounts] = [path, left].map((values) => between(values[from], values[step]));
  return { now, step, place, amounts, uploads, served };
}

// A function that shows a moment of a flight in its panel, and returns it in words.
function shower(panel, film, flight) {
  const find = (selector) => panel.querySelector(selector);
  const [picture, uav, says, here] = ["svg", ".uav", ".says", ".here"].map(find);
  const all = (selector) => [...panel.querySelectorAll(selector)];
  const [marks, shadows, links, bars] = ["[data-step]", ".shadow", ".link", ".bar"].map(all);
  const toggle = (element, visible) => element.toggleAttribute("hidden", !visible);
  let [cell, moment, shadowed] = [null, null, null]; // the cell under the pointer, the device with its shadow
  const tell = () => {
    here.textContent = cell ? aboutCell(film, cell, moment) : aboutShadow(film, shadowed);
    here.classList.toggle("violet", !cell);
  };
  const point = (event) => {
    const pointer = new DOMPoint(event.clientX, event.clientY);
    const { x, y } = pointer.matrixTransform(picture.getScreenCTM().inverse());
    const [row, col] = [Math.round(y), Math.round(x)];
    cell = event.type === "pointermove" && film.city[row]?.[col] ? [row, col] : null;
    tell();
  };
  for (const type of ["pointermove", "pointerleave"]) picture.addEventListener(type, point);

  return (time, pointed, playing) => {
    moment = momentAt(flight, time);
    const { now, place, amounts, uploads, served } = moment;
    uav.setAttribute("transform", at(place));
    for (const mark of marks) toggle(mark, Number(mark.dataset.step) < now);
    shadowed = pointed ?? served;
    shadows.forEach((shadow, k) => toggle(shadow, k === shadowed));
    links.forEach((link, k) => {
      const [[row, col], [toRow, toCol]] = [film.devices[k].cell, place];
      link.setAttribute("d", `M${col} ${row}L${toCol} ${toRow}`);
      link.setAttribute("stroke-width", 0.03 + 0.3 * share(uploads[k]));
      toggle(link, uploads[k] > 0);
    });
    bars.forEach((bar, k) => {
      const [full, digits] = [flight.left[0][k] || 1e-9, k < links.length ? 1 : 0];
      bar.style.setProperty("--left", `${(100 * amounts[k]) / full}%`);
      bar.lastChild.textContent = `${amounts[k].toFixed(digits)} of ${full.toFixed(digits)}`;
      bar.classList.toggle("on", pointed === null ? uploads[k] > 0 : pointed === k);
    });
    tell();
    const text = sentence(film, flight, moment);
    if (says.textContent !== text) says.textContent = text;
    says.setAttribute("aria-live", playing ? "off" : "polite");
    return text;
  };
}

// What happened in a step; for the last one, how the flight ended.
function sentence({ devices }, { path, left, refused, ending }, { step, uploads }) {
  if (step === path.length - 1) return ending;
  if (step === 0) return `Starts with ${left[0].at(-1)} units of time.`;
  const [down, right] = [0, 1].map((axis) => path[step][axis] - path[step - 1][axis]);
  const action = refused[step - 1];
  let does = "hovers";
  if (action) does = `may not ${action === "land" ? "land" : `fly ${action}`} here, and hovers`;
  else if (down) does = down < 0 ? "flies north" : "flies south";
  else if (right) does = right < 0 ? "flies west" : "flies east";
  const units = (amount) => (amount >= 0.1 ? amount.toFixed(1) : amount.toPrecision(1));
  const served = devices.flatMap(({ number }, k) =>
    uploads[k] > 0 ? [`device ${number} uploads ${units(uploads[k])} units`] : [],
  );
  return `Step ${step}: ${does}; ${served.join(", ") || "no upload"}.`;
}

// What is in a cell, and which devices a UAV there can see.
function aboutCell({ city, devices }, [row, col], { amounts }) {
  const texts = [`Row ${row}, column ${col}`, KINDS[city[row][col]]?.name ?? "open ground"];
  devices.forEach(({ number, cell: [y, x] }, k) => {
    if (y === row && x === col) texts.push(`device ${number}, ${amounts[k].toFixed(1)} units left`);
  });
  const seen = devices.filter(({ hidden }) => hidden[row][col] === ".").map(({ number }) => number);
  texts.push(seen.length ? `in sight: device ${seen.join(", ")}` : "no device in sight");
  return `${texts.join("; ")}.`;
}

// Which device the violet cells belong to, if there are any.
function aboutShadow({ devices }, shadowed) {
  const { number, hidden = [] } = devices[shadowed] ?? {};
  return hidden.some((row) => row.includes("#")) ? `Violet: hidden from device ${number}.` : "";
}

// From here on: HTML and SVG as text

const share = (amount) => Math.min(amount / MUCH, 1);
export const escaped = (text) => text.replace(/[&<>"]/g, (sign) => `&#${sign.charCodeAt()};`);
export const square = ([row, col]) => `M${col - 0.5} ${row - 0.5}${SQUARE}`;
export const at = ([row, col]) => `translate(${col} ${row})`;
const coloured = (colour) => `style="--colour: ${colour}"`;

const speedOption = (times) => `<option value="${times}">${times} ×</option>`;
export const CONTROLS = `<div class="controls">
  <button type="button" class="back" aria-label="one step back">&lsaquo;</button>
  <button type="button" class="play">Play</button>
  <button type="button" class="forward" aria-label="one step forward">&rsaquo;</button>
  <input type="range" min="0" aria-label="step"><output></output>
  <select aria-label="speed">${[0.25, 0.5, 1, 2, 4].map(speedOption).join("")}</select>
</div>`;

// All that is on the stage; a click on it gives it the keys, which are not the notebook's then.
const wholeStage = (film) =>
  `
  <div role="group" aria-label="${escaped(film.title)}" tabindex="-1"
      data-lm-suppress-shortcuts="true">
    ${flightPanels(film)}${CONTROLS}${legend(film)}
  </div>`.trim();
export const flightPanels = (film) =>
  `<div class="flights">${film.flights.map((each) => flightPanel(film, each)).join("")}</div>`;

// One flight: its name, map and bars, and what is said of a moment.
function flightPanel(film, flight) {
  const most = Math.max(...flight.left[0].slice(0, -1)) || 1;
  const bar = (name, about, width = 100) => `<div class="bar" ${about}><span>${name}</span><span
    class="room"><span style="width: ${width}%"></span></span><span></span></div>`;
  const bars = film.devices.map(({ number, colour }, k) => {
    const about = `data-device="${k}" tabindex="0" ${coloured(colour)}`;
    return bar(`device ${number}`, about, (100 * flight.left[0][k]) / most);
  });
  return `<div class="flight"><div class="name">${escaped(flight.name)}</div>
    <div class="map">${flightMap(film, flight)}<div class="here"></div></div>
    <div class="side"><span>what is left</span>${bars.join("")}${bar("time", "")}<div class="says"></div></div>
    </div>`;
}

export const scaleOf = (size) => Math.min(Math.max(size / 16, 0.5), 1.6); // of signs and letters

// The map with all that appears on it in the course of a flight.
function flightMap(film, flight) {
  const { city, devices, title } = film;
  const size = city.length;
  const scale = scaleOf(size);
  const scaled = (place, sign, about = "") =>
    `<g transform="${at(place)}" ${about}><g transform="scale(${scale})">${sign}</g></g>`;
  const each = (draw) => devices.map(draw).join("");
  const [west, north, side] = [-0.5 - 0.9 * scale, -0.5 - 0.2 * scale, size + 1.1 * scale];
  const sign = { landed: LANDED, crashed: CRASHED }[flight.end] ?? "";
  const end = `<g data-step="${flight.path.length - 1.5}">${sign}</g>`;
  return `<svg viewBox="${west} ${north} ${side} ${side}" role="img"
      aria-label="${escaped(`${flight.name || title}: ${flight.ending}`)}">
    <path class="paper" d="M-.5 -.5h${size}v${size}h${-size}z"/>
    <g class="under"></g>${each(({ hidden }) => shadow(hidden))}
    ${Object.keys(KINDS)
      .map((sign) => cells(city, sign))
      .join("")}
    ${grid(size, scale)}<g class="over"></g>${scaled(flight.path[0], START)}${flightPath(film, flight, scale)}
    ${each(({ colour }) => `<path class="link" ${coloured(colour)}/>`)}
    ${each((device, k) => scaled(device.cell, deviceSign(device), `data-device="${k}"`))}
    ${scaled([0, 0], UAV + end, 'class="uav"')}</svg>`;
}

// A shape in each cell that has this sign; all cells of a kind.
export const tiles = (rows, sign, shape) => {
  const tile = (each, x, y) => (each === sign ? `M${x - 0.5} ${y - 0.5}${shape}` : "");
  return rows.flatMap((row, y) => [...row].map((each, x) => tile(each, x, y))).join("");
};
export const cells = (rows, sign) => `<path class="kind-${sign}" d="${tiles(rows, sign, SQUARE)}"/>
  <path class="hatch-${sign}" d="${tiles(rows, sign, KINDS[sign].hatch)}"/>`;
const shadow = (hidden) => `<path class="shadow" d="${tiles(hidden, "#", SQUARE)}"/>`;

// The lines between the cells, and the numbers of rows and columns
function grid(size, scale) {
  const edges = size <= 32 ? [...Array(size - 1).keys()].map((each) => each + 0.5) : [];
  const lines = edges.map((each) => `M${each} -.5v${size}M-.5 ${each}h${size}`).join("");
  const aside = 0.5 + 0.45 * scale;
  let numbers = "";
  for (let tick = 0; tick < size; tick += Math.max(1, Math.round(size / 8))) {
    numbers += `<text x="${tick}" y="${size - 1 + aside}" dy=".35em">${tick}</text>`;
    numbers += `<text x="${-aside}" y="${tick}" dy=".35em">${tick}</text>`;
  }
  return `<path class="grid" d="${lines}"/><g font-size="${0.5 * scale}">${numbers}</g>`;
}

// An arrow for each move, and rings for hovering, the larger the longer it has hovered there.
function flightPath({ devices }, flight, scale) {
  const { path, end } = flight;
  const hovered = {}; // steps by cell
  const sign = (next, step) => {
    const { uploads, served } = momentAt(flight, step + 1);
    const about = `data-step="${step}" ${coloured(devices[served]?.colour ?? "currentColor")}`;
    const width = scale * (0.06 + 0.24 * share(uploads[served] ?? 0));
    const [down, right] = [0, 1].map((axis) => next[axis] - path[step][axis]);
    const turn = (Math.atan2(down, right) * 180) / Math.PI;
    const place = `transform="${at(path[step])} rotate(${turn})"`;
    if (down || right) return `<g ${place} ${about}>${arrow(width)}</g>`;
    hovered[next] = (hovered[next] ?? 0) + 1;
    const size = `r="${scale * Math.min(0.42 + 0.04 * hovered[next], 0.8)}"`;
    return `<circle class="ring" ${size} stroke-width="${width / 3}" ${place} ${about}/>`;
  };
  return path
    .slice(1, end === "landed" ? -1 : undefined)
    .map(sign)
    .join("");
}

// An arrow to the next cell in the east, to the right of the path, so that there and back differ.
function arrow(width, aside = 0.16) {
  const [left, right] = [aside - width / 2, aside + width / 2];
  const [from, to] = [left - 0.12, right + 0.12];
  return `<path class="arrow" d="M0 ${left}H.62V${from}L1 ${aside}L.62 ${to}V${right}H0z"/>`;
}

const deviceSign = ({ number, colour }) =>
  `<g class="device" ${coloured(colour)}>${CROSS}<text dy=".35em">${number}</text></g>`;

// What all signs mean, in the words of `add_legend` in plotting.py.
export function legend({ city, devices }) {
  const kinds = Object.keys(KINDS).filter((sign) => city.some((row) => row.includes(sign)));
  const move = (width) => `<g transform="translate(-.5)">${arrow(width, 0)}</g>`;
  const entries = [
    ...kinds.map((sign) => [KINDS[sign].name, cells([sign], sign)]),
    ["shadow: no line of sight to a device", shadow(["#"])],
    ...devices.map((device) => [`device ${device.number}`, deviceSign({ ...device, number: "" })]),
    ["UAV", `<g class="uav">${UAV}</g>`],
    ["start", START],
    ["landing", LANDED],
    ["crash", CRASHED],
    ["move: thicker for more data, in the colour of its device", move(0.16)],
    ["hovering", '<circle class="ring" r=".46" stroke-width=".08"/>'],
  ];
  const draw = ([name, sign]) => `<span><svg viewBox="-.6 -.6 1.2 1.2">${sign}</svg>${name}</span>`;
  return `<div class="legend">${entries.map(draw).join("")}</div>`;
}
