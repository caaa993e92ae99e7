// Plays the flights that drawing.py has drawn. Time is counted in steps: at 3.5 the UAV is half-way
// from its cell after 3 steps to that after 4. labs/stage.js starts it.
const SPEED = 4; // steps a second
const CONTROLS = `
  <button type="button" data-move="-1" aria-label="one step back">&lsaquo;</button>
  <button type="button" class="play">Play</button>
  <button type="button" data-move="1" aria-label="one step forward">&rsaquo;</button>
  <input type="range" min="0" step="any" aria-label="step">
  <output></output>
  <select aria-label="speed">
    <option value="0.25">¼ ×</option><option value="0.5">½ ×</option>
    <option value="1" selected>1 ×</option><option value="2">2 ×</option>
    <option value="4">4 ×</option>
  </select>`;

// Starts a player, and returns what others may do with it. `shown(time)` is called for each moment
// that it shows. Without `keyboard`, the keys are somebody else's.
function start(root, { keyboard = true, shown = () => {} } = {}) {
  const data = JSON.parse(root.querySelector("script").textContent);
  const panels = root.querySelectorAll(".flight");
  const flights = data.flights.map((film, index) => flight(panels[index], film, data));
  const last = Math.max(...data.flights.map((film) => film.says.length - 1));
  const calm = matchMedia("(prefers-reduced-motion: reduce)");

  const controls = document.createElement("div");
  controls.className = "controls";
  controls.innerHTML = CONTROLS;
  root.querySelector(".flights").after(controls);
  const find = (selector) => controls.querySelector(selector);
  const [play, slider, counter, speed] = [".play", "input", "output", "select"].map(find);
  slider.max = last;

  let time = last; // the whole flight, as in the picture
  let pointedAt = null; // a device
  let pinned = null; // the device of the row that was clicked
  let before = null; // when the last frame was drawn, ms; null while paused

  function show() {
    const now = before !== null && calm.matches ? Math.floor(time) : time;
    const texts = flights.map((draw) => draw(now, pointedAt ?? pinned, before !== null));
    slider.value = now;
    counter.textContent = `${Math.ceil(now)} of ${last}`;
    slider.setAttribute("aria-valuetext", `step ${counter.textContent}. ${texts.join(" ")}`);
    shown(now);
  }

  function pause() {
    before = null;
    play.textContent = "Play";
    show();
  }

  function go(to) {
    time = Math.min(Math.max(to, 0), last);
    pause();
  }

  function toggle() {
    if (before !== null) return pause();
    playFrom(time >= last ? 0 : time);
  }

  function playFrom(then) {
    time = then;
    before = performance.now();
    play.textContent = "Pause";
    requestAnimationFrame(frame);
  }

  function frame(now) {
    if (before === null || !root.isConnected) return;
    const seconds = Math.min(Math.max(now - before, 0), 100) / 1000; // the page may have slept
    before = now;
    time = Math.min(time + SPEED * speed.value * seconds, last);
    if (time === last) return pause();
    show();
    requestAnimationFrame(frame);
  }

  const back = () => go(Math.ceil(time) - 1);
  const forward = () => go(Math.floor(time) + 1);
  const keys = {
    " ": toggle,
    ArrowLeft: back,
    ArrowRight: forward,
    Home: () => go(0),
    End: () => go(last),
  };
  root.addEventListener("keydown", (event) => {
    const own = event.target.matches(event.key === " " ? "button, select" : "select");
    if (!keyboard || !keys[event.key] || own || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    keys[event.key]();
  });
  play.addEventListener("click", toggle);
  find("[data-move='-1']").addEventListener("click", back);
  find("[data-move='1']").addEventListener("click", forward);
  slider.addEventListener("input", () => go(Number(slider.value)));
  slider.addEventListener("change", () => go(Math.round(time)));

  for (const each of root.querySelectorAll("[data-device]")) {
    const point = (device) => () => {
      pointedAt = device;
      show();
    };
    const here = point(Number(each.dataset.device));
    each.tabIndex = each.closest("svg") ? -1 : 0;
    for (const type of ["pointerenter", "focus"]) each.addEventListener(type, here);
    for (const type of ["pointerleave", "blur"]) each.addEventListener(type, point(null));
  }
  // A click on a device's row keeps what is shown of it, until the next click on a row or on a map.
  root.addEventListener("click", (event) => {
    if (event.target.closest(".controls, .slider")) return;
    const row = event.target.closest(".bar[data-device]");
    const device = row ? Number(row.dataset.device) : null;
    pinned = device === pinned ? null : device;
    show();
  });
  show();
  return { go, playFrom, speed, last };
}

// Puts the drawing in place of the picture, and returns a function that shows a moment.
function flight(panel, film, { most, widest }) {
  const picture = panel.querySelector(".map img");
  const source = atob(picture.src.split(",")[1]);
  const parsed = new DOMParser().parseFromString(source, "image/svg+xml").documentElement;
  const svg = document.importNode(parsed, true);
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", picture.alt);
  picture.replaceWith(svg);

  const all = (selector) => [...panel.querySelectorAll(selector)];
  const [uav, says] = [svg.querySelector("[data-uav]"), panel.querySelector(".says")];
  const [links, shadows] = ["[data-link]", "[data-shadow]"].map(all);
  const bars = all(".bar").map((bar) => ({
    bar,
    fill: bar.querySelector(".fill"),
    amount: bar.querySelector(".left"), // somebody may take it off the page
  }));
  const timed = all("[data-from]").map((element) => ({
    element,
    from: Number(element.dataset.from),
    until: Number(element.dataset.until ?? Infinity),
  }));
  const last = film.says.length - 1;
  const thinnest = widest / 20;
  const visible = (element, is) => {
    const value = is ? "visible" : "hidden";
    if (element.getAttribute("visibility") !== value) element.setAttribute("visibility", value);
  };

  return (time, pointedAt, playing) => {
    const now = Math.min(time, last);
    const step = Math.max(Math.ceil(now) - 1, 0); // the step that is being flown
    const next = Math.min(step + 1, last);
    const between = (values) => values[step] + (now - step) * (values[next] - values[step]);
    const [x, y] = [between(film.x), between(film.y)];
    uav.setAttribute("transform", `translate(${x} ${y})`);
    for (const { element, from, until } of timed) visible(element, from < now && now <= until);

    const amounts = links.map((_, k) => (now > 0 ? film.left[k][step] - film.left[k][next] : 0));
    const largest = Math.max(...amounts);
    links.forEach((link, k) => {
      const width = (widest * amounts[k]) / most;
      visible(link, amounts[k] > 0);
      link.setAttribute("x2", x);
      link.setAttribute("y2", y);
      link.setAttribute("stroke-width", Math.max(width, thinnest));
      link.setAttribute("stroke-dasharray", width < thinnest ? 4 * thinnest : "none");
      const pointed = pointedAt === Number(link.dataset.link);
      const served = amounts[k] > 0 && amounts[k] === largest;
      visible(shadows[k], pointedAt === null ? served : pointed);
      bars[k].bar.classList.toggle("on", pointedAt === null ? amounts[k] > 0 : pointed);
    });
    bars.forEach(({ fill, amount }, k) => {
      const left = between(film.left[k]);
      fill.style.width = `${(100 * left) / film.left[k][0]}%`;
      amount.textContent = left.toFixed(k < links.length ? 1 : 0);
    });

    const text = film.says[now > 0 ? next : 0];
    if (says.textContent !== text) says.textContent = text;
    says.setAttribute("aria-live", playing ? "off" : "polite");
    return text;
  };
}
