// The stage on a page of its own: what a notebook does for a widget, by a socket to the server.

import stage from "./stage.js";

const TAKEN = 4000; // the code with which the server ends a connection when its tab was doubled
const hears = {};
const unsent = [];
let [scene, socket] = [null, null];
const model = {
  get: () => scene,
  on: (event, hear) => (hears[event] = hear),
  send(told) {
    unsent.push(told);
    flush();
  },
};

function flush() {
  if (socket.readyState !== WebSocket.OPEN) return;
  for (const told of unsent.splice(0)) socket.send(JSON.stringify(told));
}

// The server knows the session again, after a reload or a connection that was cut
function connect() {
  const address = new URL(`socket?session=${sessionStorage.session ?? ""}`, location.href);
  address.protocol = address.protocol.replace("http", "ws");
  socket = new WebSocket(address);
  socket.onopen = () => {
    document.getElementById("lost").hidden = true;
    flush();
  };
  socket.onmessage = ({ data }) => {
    const told = JSON.parse(data);
    if (told.kind === "file") return hears["msg:custom"](told);
    const before = scene;
    const another = told.session !== sessionStorage.session;
    [scene, sessionStorage.session] = [told.scene, told.session];
    if (!before) stage.render({ model, el: document.getElementById("stage") });
    else if (another) location.reload(); // it begins where the address says
    else hears["change:scene"]();
  };
  socket.onclose = ({ code }) => {
    if (code === TAKEN) {
      sessionStorage.removeItem("session");
      return location.reload(); // with a session of its own, where the address says
    }
    document.getElementById("lost").hidden = false;
    setTimeout(connect, 1000);
  };
}

connect();
