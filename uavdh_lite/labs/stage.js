// The stage of a lab. It plays what Python draws, tells Python which step it shows, and what is
// dragged and pressed here. drawing.js, which stands before this text, has `start`,
// and fullscreen.js `fullScreenButton`.
const SVG = "http://www.w3.org/2000/svg";
const FINEST = { data: 0.5, time: 1 }; // what an arrow key adds to a bar
const MOVES = { ArrowUp: [-1, 0], ArrowRight: [0, 1], ArrowDown: [1, 0], ArrowLeft: [0, -1] };

function render({ model, el }) {
  el.classList.add("uavdh-stage");
  let player = null;
  let drawn = null; // the drawing that is shown
  let held = null; // what is being dragged
  let told = null; // the step that Python knows of
  // What keys have set since Python last answered, by its name. Keys count on from there: what is
  // drawn meanwhile is older.
  let wanted = {};
  let isAhead = false; // whether what is shown is not what Python drew
  let sent = model.get("answered");
  const steered = () => model.get("steering").length > 0; // then the step is always the last one

  // The flights and what belongs to them
  const fullScreen = fullScreenButton(() => el.closest(".uavdh-together") ?? el);

  function draw() {
    const speed = player?.speed.value;
    const focused = nameOf(document.activeElement);
    drawn = model.get("drawing");
    el.innerHTML = drawn;
    isAhead = false;
    [player, held] = [null, null];
    const root = el.querySelector(".uavdh-player");
    if (!root) return;
    const think = thoughts(root, model.get("q_values"));
    const shown = (time) => {
      think(Math.floor(time));
      const step = Math.ceil(time);
      if (step === told || player === null || steered()) return;
      told = step;
      model.set("step", step);
      model.save_changes();
    };
    player = start(root, { keyboard: !steered(), shown });
    const begin = model.get("begin");
    told = begin < 0 ? model.get("step") : begin;
    if (speed) player.speed.value = speed;
    const controls = root.querySelector(".controls");
    controls.append(fullScreen);
    root.prepend(controls); // next to what a lab says of the step, and in sight on a low screen
    if (model.get("editable")) makeEditable(root);
    fit();
    markRefusal(root);
    if (steered()) {
      root.removeAttribute("tabindex"); // a click on the map gives the focus to all around it
      el.tabIndex = 0;
      el.setAttribute("role", "application"); // screen readers leave it the keys
      el.setAttribute("aria-label", "the map: arrow keys fly, space hovers, Enter lands");
    }
    if (focused) el.querySelector(focused)?.focus({ preventScroll: true });
    if (begin >= 0) player.playFrom(Math.min(begin, player.last));
    else if (told !== player.last) player.go(told);
  }

  // What fills the screen: maps as large as they can be with all that belongs to them in sight.
  function fit() {
    const whole = document.fullscreenElement;
    const root = el.querySelector(".uavdh-player");
    const isAlone = whole?.contains(el) && !el.closest(".uavdh-beside");
    const panels = isAlone && root ? root.querySelectorAll(".flight") : [];
    const isFlat = innerWidth > 1.2 * innerHeight; // else what is beside one map is below it
    const shown = panels.length > 1 ? "several" : panels.length === 1 && isFlat ? "one" : "";
    if (el.dataset.full !== shown) el.dataset.full = shown;
    if (!shown) return;
    const map = panels[0].querySelector(".map");
    const [{ top }, { height }] = [whole, map].map((each) => each.getBoundingClientRect());
    const lasts = [...panels].map((each) => (shown === "one" ? map : each.querySelector(".side")));
    const end = () =>
      Math.max(...lasts.map((last) => last.getBoundingClientRect().bottom)) - top + whole.scrollTop;
    const room = innerHeight - (end() - height) - 8; // less what is above and below the map
    el.style.setProperty("--map", `${Math.max(room, 0.4 * innerHeight)}px`);
    const left = innerHeight - end();
    const legend = root.querySelector(".legend").getBoundingClientRect().height;
    el.style.setProperty("--below", `${legend + 10 > left ? Math.max(left, 6) : 6}px`);
  }
  const sizes = new ResizeObserver(fit);
  function fill() {
    sizes.disconnect();
    const sentences = document.fullscreenElement?.querySelectorAll(".uavdh-sentence") ?? [];
    for (const each of [el, ...sentences]) sizes.observe(each); // which also fits the maps now
  }
  fill();
  document.addEventListener("fullscreenchange", fill);
  window.addEventListener("resize", fit);

  // A selector that finds the same control in the next drawing.
  function nameOf(element) {
    if (!element || element === el || !el.contains(element)) return null;
    const label = element.getAttribute("aria-label");
    const named = label && `[aria-label="${CSS.escape(label)}"]`;
    if (element.dataset.device && element.closest("svg")) {
      return `svg [data-device="${element.dataset.device}"]`;
    }
    return element.matches(".play") ? ".play" : named;
  }

  function send(kind, told) {
    sent += 1;
    model.send({ kind, ...told });
  }

  // Python has done what a message asked for, or has refused it.
  function answered() {
    if (model.get("answered") < sent) return;
    sent = model.get("answered");
    wanted = {};
    if (isAhead) draw();
  }

  // A move that was refused: the border of the UAV's cell that it would have crossed is red.
  function markRefusal(root) {
    const refused = model.get("refused");
    const uav = root.querySelector("[data-uav]");
    if (!refused.length || !uav) return;
    const [down, right] = refused;
    const border = document.createElementNS(SVG, "path");
    const [along, across] = [Math.abs(down), Math.abs(right)];
    const side = `M${(right - along) / 2} ${(down - across) / 2}l${along} ${across}`;
    border.setAttribute("d", along || across ? side : "M-.5 -.5h1v1h-1z");
    border.setAttribute("class", "refused");
    border.setAttribute("transform", uav.getAttribute("transform"));
    uav.before(border);
    uav.classList.add("shaken");
  }

  // Maps: a device or the start is dragged; the same cell twice is a click.
  function placeOf(svg, event) {
    const matrix = svg.getScreenCTM().inverse();
    return new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix);
  }

  // Up to half a cell outside of the map, the nearest cell is meant.
  function cellOf({ x, y }) {
    const last = model.get("size") - 1;
    const nearest = (value) => Math.min(Math.max(value, 0), last);
    return [y, x].map((value) => {
      const near = nearest(value);
      return Math.round(Math.abs(value - near) <= 1 ? near : value);
    });
  }

  const isInside = (cell) => cell.every((each) => each >= 0 && each < model.get("size"));

  function movedTo(selector, { x, y }) {
    for (const each of el.querySelectorAll(selector)) {
      each.setAttribute("transform", `translate(${x} ${y})`);
    }
  }

  function makeEditable(root) {
    for (const svg of root.querySelectorAll(".map svg")) {
      svg.setAttribute("role", "group"); // devices in it take keys
      for (const device of svg.querySelectorAll("[data-device]")) {
        device.tabIndex = 0;
        device.setAttribute("role", "button");
        const about = `${device.querySelector("title").textContent}: arrow keys move it`;
        device.setAttribute("aria-label", about);
      }
    }
    for (const [name, cell] of Object.entries(wanted)) {
      if (name.startsWith("place")) moveAhead(name.split(" ")[1], cell);
    }
    for (const bar of root.querySelectorAll(".bar")) makeSlider(bar);
  }

  // Show a device where keys have moved it.
  function moveAhead(device, [y, x]) {
    wanted[`place ${device}`] = [y, x];
    isAhead = true;
    movedTo(`.map [data-device="${device}"]`, { x, y });
  }

  // A device's line begins in its cell.
  const cellOfLink = (line) => ["y1", "x1"].map((name) => Number(line.getAttribute(name)));
  const same = (one, other) => one[0] === other[0] && one[1] === other[1];

  function deviceAt(svg, cell) {
    const here = (line) => same(cellOfLink(line), cell);
    return [...svg.querySelectorAll("[data-link]")].find(here)?.dataset.link ?? null;
  }

  // The map under a mouse or a finger, the cell, and what can be dragged from there.
  function grip(event) {
    const svg = event.target.closest(".map svg");
    if (!svg || !model.get("editable")) return null;
    const from = cellOf(placeOf(svg, event));
    const device = deviceAt(svg, from);
    const isStart = svg.querySelector("[data-start]").dataset.start === from.join();
    const what = device !== null ? `.map [data-device="${device}"]` : isStart && "[data-start]";
    return { svg, from, what };
  }

  el.addEventListener("pointerdown", (event) => {
    held = event.button === 0 ? grip(event) : null;
    if (held?.what) event.preventDefault(); // no text is selected
  });
  const scrolls = (event) => {
    const [finger] = event.changedTouches;
    const { clientX, clientY } = finger;
    if (grip({ target: finger.target, clientX, clientY })?.what) event.preventDefault();
  };
  el.addEventListener("touchstart", scrolls, { passive: false }); // it drags, and does not scroll
  el.addEventListener("pointermove", (event) => {
    if (held?.what) movedTo(held.what, placeOf(held.svg, event));
  });
  window.addEventListener("pointerup", released);
  window.addEventListener("pointercancel", cancel);

  function released(event) {
    if (!held) return;
    const { svg, from, what } = held;
    held = null;
    const to = cellOf(placeOf(svg, event));
    if (what && !same(from, to)) movedTo(what, { x: to[1], y: to[0] });
    if (what || (same(from, to) && isInside(to))) send("drop", { from, to });
  }

  function cancel() {
    if (held) draw();
  }

  // Bars: what there is at the start of the mission is set by dragging or by keys.
  function makeSlider(bar) {
    const device = bar.dataset.device ?? null;
    const kind = device === null ? "time" : "data";
    const [room, track] = [".room", ".track"].map((selector) => bar.querySelector(selector));
    const number = bar.querySelector(".number");
    const [most, least] = [model.get("most")[kind], FINEST[kind]];
    const given = Number(number.textContent.split(" of ")[1]);
    const digits = kind === "data" ? 1 : 0;
    const longest = Math.max(most, given);
    const within = (value) => Math.min(Math.max(value, least), longest);
    const name = `${kind} ${device}`;
    let now = wanted[name] ?? given;
    if (now !== given) isAhead = true;
    bar.tabIndex = -1;
    room.classList.add("slider");
    room.tabIndex = 0;
    const about = {
      role: "slider",
      "aria-label": device === null ? "flying time" : `data of device ${device}`,
      "aria-valuemin": least,
      "aria-valuemax": longest,
      title: "drag to change what there is at the start",
    };
    for (const [name, value] of Object.entries(about)) room.setAttribute(name, value);

    function preview(value) {
      track.style.width = `${(100 * value) / longest}%`;
      room.setAttribute("aria-valuenow", value);
      if (value !== given) number.textContent = `start: ${value.toFixed(digits)}`;
    }

    function set(value) {
      preview(value);
      if (value === now) return;
      now = wanted[name] = value;
      isAhead = true;
      send(kind, { device: device && Number(device), value });
    }

    function under(event) {
      const { left, width } = room.getBoundingClientRect();
      const value = ((event.clientX - left) / width) * longest;
      return within(Math.round(value / least) * least);
    }

    preview(now);
    room.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      event.preventDefault();
      room.focus({ preventScroll: true });
      room.setPointerCapture(event.pointerId);
      preview(under(event));
    });
    room.addEventListener("pointermove", (event) => {
      if (room.hasPointerCapture(event.pointerId)) preview(under(event));
    });
    room.addEventListener("pointerup", (event) => set(under(event)));
    const steps = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -5, PageUp: 5 };
    room.addEventListener("keydown", (event) => {
      const to = { Home: least, End: longest }[event.key] ?? now + least * steps[event.key];
      if (Number.isNaN(to)) return;
      event.preventDefault();
      event.stopPropagation(); // the keys are the slider's, not the player's
      set(within(to));
    });
  }

  // Keys that steer the UAV do so wherever the focus is in the lab, or if nothing has it. What is
  // typed into a field is the field's, and a button that was reached by Tab keeps space and Enter.
  const lab = () => el.closest(".uavdh-fly") ?? el;

  function steers(event) {
    const { key, target } = event;
    if (!model.get("steering").includes(key) || !el.checkVisibility()) return;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const byMouse = target.matches("[role=tab]") && !target.matches(":focus-visible");
    if (!(target === document.body || byMouse || lab().contains(target))) return;
    if (target.matches("input, textarea, select, [contenteditable]")) return;
    if ([" ", "Enter"].includes(key) && target.closest("button, a, summary")) return;
    event.preventDefault();
    event.stopPropagation();
    send("key", { key });
  }
  document.addEventListener("keydown", steers, { capture: true });

  // After a click on a button, the next keys are for the map; who plays by keys stays where they are.
  function clicked(event) {
    const button = event.target.closest?.("button");
    if (!steered() || !button || !lab().contains(button)) return;
    const plays = el.contains(button) && button !== fullScreen;
    if (event.detail || !plays) el.focus({ preventScroll: true });
  }
  document.addEventListener("click", clicked);

  // Keys that move the device that has the focus
  function pressed(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const device = event.target.closest("svg [data-device]");
    if (device && model.get("editable") && MOVES[event.key]) {
      event.preventDefault();
      event.stopPropagation();
      const [svg, number] = [device.ownerSVGElement, device.dataset.device];
      const line = svg.querySelector(`[data-link="${number}"]`);
      const from = wanted[`place ${number}`] ?? cellOfLink(line);
      const move = MOVES[event.key];
      const to = [from[0] + move[0], from[1] + move[1]];
      if (isInside(to) && deviceAt(svg, to) === null) moveAhead(number, to);
      send("drop", { from, to });
    }
  }
  el.addEventListener("keydown", pressed, { capture: true });

  // Undo and redo, while the mouse is over the stage or the focus in it
  function undoes(event) {
    const by = { z: -1, y: 1 }[event.key];
    const writing = event.target.matches?.("input:not([type=range]), textarea, select");
    if (!by || writing || event.ctrlKey || event.metaKey || event.altKey) return;
    if (!model.get("editable") || !el.matches(":hover, :focus-within")) return;
    send("undo", { by });
  }
  document.addEventListener("keydown", undoes);

  // A step that comes with a new drawing is not one of this drawing's.
  const follow = () => {
    if (player === null || steered() || model.get("step") === told) return;
    if (model.get("drawing") !== drawn) return;
    told = model.get("step");
    player.go(told);
  };
  model.on("change:answered", answered);
  model.on("change:drawing", draw);
  model.on("msg:custom", draw);
  model.on("change:step", follow);
  draw();
  return () => {
    sizes.disconnect();
    document.removeEventListener("fullscreenchange", fill);
    window.removeEventListener("resize", fit);
    model.off("change:answered", answered);
    model.off("change:drawing", draw);
    model.off("msg:custom", draw);
    model.off("change:step", follow);
    document.removeEventListener("keydown", undoes);
    document.removeEventListener("keydown", steers, { capture: true });
    document.removeEventListener("click", clicked);
    window.removeEventListener("pointerup", released);
    window.removeEventListener("pointercancel", cancel);
  };
}

// What the agent of the first flight thinks, around its UAV: an arrow for each move, a ring for
// hovering, a square for landing, the larger the better; the best one is blue. Returns a function
// that shows the thoughts at a step.
function thoughts(root, qValues) {
  if (!qValues.length) return () => {};
  const { flights } = JSON.parse(root.querySelector("script").textContent);
  const [film] = flights;
  const group = document.createElementNS(SVG, "g");
  group.setAttribute("class", "thoughts");
  return (step) => {
    const drawn = root.querySelector(".map svg");
    if (group.parentNode !== drawn) drawn.append(group);
    group.replaceChildren();
    const values = qValues[step];
    if (!values) return;
    const best = values.indexOf(Math.max(...values.filter((value) => value !== null)));
    group.setAttribute("transform", `translate(${film.x[step]} ${film.y[step]})`);
    values.forEach((value, action) => {
      if (value === null) return;
      const shape = document.createElementNS(SVG, action === 4 ? "circle" : "path");
      if (action < 4) {
        const [length, half] = [0.75 + 1.1 * value, 0.1 + 0.1 * value];
        const neck = length - 0.3;
        shape.setAttribute("d", `M${-half} -.45V${-neck}H${-half - 0.17}L0 ${-length}L${half + 0.17} ${-neck}H${half}V-.45z`);
        shape.setAttribute("transform", `rotate(${90 * action})`);
      } else if (action === 4) {
        shape.setAttribute("r", 0.3 + 0.25 * value);
      } else {
        const side = 0.35 + 0.25 * value;
        shape.setAttribute("d", `M${-side} ${-side}h${2 * side}v${2 * side}h${-2 * side}z`);
      }
      shape.setAttribute("class", action === best ? "best" : "other");
      shape.classList.toggle("line", action >= 4);
      group.append(shape);
    });
  };
}

export default { render };
