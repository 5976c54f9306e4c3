// Explore: panels of signals over one axis of time, or of their spectra. What is shown is fetched for the stretch that
// is shown; below stand what happened in the log, and the autopilot's parameters.
"use strict";

(function () {
  const form = document.getElementById("explore");
  const address = form.dataset.address;
  const message = document.getElementById("message"), field = document.getElementById("field");
  const expression = document.getElementById("expression"), below = document.getElementById("below");
  const view = document.getElementById("view"), state = document.getElementById("explore-state"), place = document.getElementById("plots");
  const COLORS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#b8860b", "#7a5fb5", "#777777"];

  // What is looked at most; a log may lack some of it.
  const VIEWS = {
    attitude: [["deg(attitude.roll)", "deg(setpoints.roll)", "deg(attitude.pitch)", "deg(setpoints.pitch)"]],
    motors: [[1, 2, 3, 4, 5, 6, 7, 8].map((k) => `motors.m${k}`)],
    height: [["baro.alt", "-ekf.p_d"]],
    battery: [["battery.voltage", "battery.current"]],
    vibration: [["imu.gyro_x", "imu.gyro_y", "imu.gyro_z"], ["imu.accel_x", "imu.accel_y", "imu.accel_z"]],
  };

  // Each panel: {node, texts, spectrum}. The stretch that all show; null is the whole log.
  const panels = [];
  let span = null, waiting = null, asked = 0, moments = [], ends = [0, 0];

  async function get(path) {
    const response = await fetch(address + path);
    if (response.status === 401) location.assign(`/sign-in?next=${encodeURIComponent(location.pathname)}`);
    const answer = await response.json();
    if (!response.ok) throw new Error(answer.detail ?? `The service answered with an error (${response.status}).`);
    return answer;
  }

  function tell(text, wrong = false) {
    state.textContent = text;
    state.classList.toggle("wrong", wrong);
  }

  function fill(select, first, options) {
    select.replaceChildren(new Option(first, ""), ...options.map(([text, value]) => new Option(text, value)));
    select.disabled = !options.length;
  }

  async function fetchInto(shown, quietly = false) {
    const turn = ++asked;
    tell("Reading …");
    try {
      const problems = [];
      for (const spectrum of [false, true]) {
        const alike = shown.filter((panel) => panel.spectrum === spectrum && panel.texts.length);
        if (!alike.length) continue;
        const query = new URLSearchParams([...new Set(alike.flatMap((panel) => panel.texts))].map((text) => ["signal", text]));
        query.set("points", String(Math.min(4000, 2 * Math.max(400, place.clientWidth))));
        query.set("spectrum", String(spectrum));
        if (span) { query.set("start", span[0]); query.set("stop", span[1]); }
        const { signals, rotors_hz } = await get(`/signals?${query}`);
        if (turn !== asked && shown === panels) return;  // a newer stretch is on its way
        const found = new Map(signals.map((signal) => [signal.text, signal]));
        problems.push(...signals.filter((signal) => signal.problem));
        for (const panel of [...alike]) {
          panel.texts = panel.texts.filter((text) => !found.get(text)?.problem);
          if (panel.texts.length) draw(panel, panel.texts.map((text) => found.get(text)), rotors_hz);
          else close(panel);
        }
      }
      const wrong = problems.length > 0 && !(quietly && panels.length);
      tell(wrong ? problems.map((signal) => signal.problem).join(" ") : "", wrong);
      remember();
    } catch (error) {
      tell(error instanceof TypeError ? "The service does not answer." : error.message, true);
    }
  }

  // Text of a log is text, whatever Plotly takes for markup.
  const plain = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;");

  function draw(panel, signals, rotors) {
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink").trim() || "#222", grid = style.getPropertyValue("--line").trim() || "#ddd";
    const units = [...new Set(signals.map((signal) => signal.unit))];
    const data = signals.map((signal, k) => ({
      type: "scatter", mode: signal.samples < 60 ? "lines+markers" : "lines", name: plain(signal.text), x: signal.hz ?? signal.t,
      y: signal.y, line: { width: 1.3, color: COLORS[k % COLORS.length] }, yaxis: units.indexOf(signal.unit) === 0 ? "y" : "y2",
    }));
    const axis = (unit) => ({ title: { text: plain(unit) }, gridcolor: grid, zerolinecolor: grid, automargin: true });
    const last = panel.spectrum ? Math.max(...signals.map((signal) => signal.hz.at(-1))) : 0;
    const along = panel.spectrum
      ? { title: { text: "frequency (Hz)" }, gridcolor: grid, zeroline: false, range: [0, last] }
      : { title: { text: "time on the log’s clock (s)" }, gridcolor: grid, zeroline: false, range: span ?? undefined };
    const layout = {
      margin: { l: 60, r: units.length > 1 ? 60 : 14, t: 30, b: 40 }, font: { color: ink }, showlegend: false,
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", xaxis: along, yaxis: axis(units[0]), hovermode: "x",
      ...(panel.spectrum ? rotorLines(rotors, last, ink) : bands(ink)),
    };
    // A third unit shares the right axis, which then names them all. Its ticks are its own, and not where the left has some.
    if (units.length > 1) {
      layout.yaxis2 = { ...axis(units.slice(1).join(", ")), overlaying: "y", side: "right", showgrid: false, tickmode: "auto" };
    }
    if (panel.spectrum) for (const each of [layout.yaxis, layout.yaxis2]) if (each) Object.assign(each, { type: "log", dtick: 1 });
    const first = !panel.drawn;
    panel.drawn = true;
    Plotly.react(panel.plot, data, layout, { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d"] });
    if (first) panel.plot.on("plotly_relayout", (change) => { if (!panel.spectrum) zoomed(change); });
    const other = button(panel.spectrum ? "Over time" : "Spectrum", () => {
      panel.spectrum = !panel.spectrum;
      fetchInto([panel]);
    });
    panel.list.replaceChildren(...panel.texts.map((text, k) => {
      const remove = button(text, () => {
        panel.texts = panel.texts.filter((each) => each !== text);
        if (panel.texts.length) fetchInto([panel]); else { close(panel); remember(); }
      });
      const line = document.createElement("span");
      line.className = "swatch";
      line.style.background = COLORS[k % COLORS.length];
      remove.prepend(line);
      remove.append(" ×");
      remove.setAttribute("aria-label", `Remove ${text}`);
      return remove;
    }), other);
  }

  function button(text, act) {
    const made = document.createElement("button");
    Object.assign(made, { type: "button", className: "plain", textContent: text });
    made.addEventListener("click", act);
    return made;
  }

  // Flight modes as quiet bands, events as thin lines; texts stand in the list below.
  function bands(ink) {
    const modes = moments.filter((each) => each.kind === "mode");
    const shapes = modes.map(({ t }, k) => ({
      type: "rect", x0: t, x1: modes[k + 1]?.t ?? ends[1], y0: 0, y1: 1, yref: "paper", line: { width: 0 }, layer: "below",
      fillcolor: k % 2 ? "rgba(128,128,128,0.13)" : "rgba(128,128,128,0.03)",
    }));
    const events = moments.filter((each) => each.kind === "event");
    shapes.push(...(events.length > 80 ? [] : events).map(({ t }) => ({
      type: "line", x0: t, x1: t, y0: 0, y1: 1, yref: "paper", line: { width: 1, dash: "dot", color: ink }, opacity: 0.4,
    })));
    // A name stands where its band has room for it.
    const [begin, end] = span ?? ends, wide = (place.clientWidth - 120) / (end - begin);  // without its margins
    const annotations = modes.flatMap(({ t, text }, k) => {
      const from = Math.max(t, begin), to = Math.min(modes[k + 1]?.t ?? ends[1], end);
      return (to - from) * wide > 8 * text.length ? [label(from, text)] : [];
    });
    return { shapes, annotations };
  }

  function rotorLines(rotors, last, ink) {
    if (!rotors) return {};
    const seen = [1, 2, 3].filter((k) => k * rotors[0] < last);
    const shapes = seen.map((k) => ({
      type: "rect", x0: k * rotors[0], x1: k * rotors[1], y0: 0, y1: 1, yref: "paper", line: { width: 0 }, layer: "below",
      fillcolor: ink, opacity: 0.12,
    }));
    const turned = `motors at ${rotors[0].toFixed(0)} to ${rotors[1].toFixed(0)} Hz`;
    const annotations = seen.map((k) => label(k * rotors[0], k === 1 ? turned : `${k} ×`));
    return { shapes, annotations: seen.length ? annotations : [label(0, `${turned}: too fast for these samples`)] };
  }

  const label = (x, text) => ({
    x, y: 1, yref: "paper", text: plain(text), showarrow: false, xanchor: "left", yanchor: "bottom", font: { size: 11 },
  });

  function zoomed(change) {
    if (change["xaxis.autorange"]) span = null;
    else if ("xaxis.range[0]" in change) span = [Number(change["xaxis.range[0]"]), Number(change["xaxis.range[1]"])];
    else if (Array.isArray(change["xaxis.range"])) span = change["xaxis.range"].map(Number);
    else return;
    clearTimeout(waiting);
    waiting = setTimeout(() => fetchInto(panels), 120);
  }

  function close(panel) {
    Plotly.purge(panel.plot);
    panel.node.remove();
    panels.splice(panels.indexOf(panel), 1);
  }

  function add(texts, apart, spectrum = false, quietly = false) {
    let panel = panels.at(-1);
    if (!panel || apart) {
      const node = document.createElement("section"), plot = document.createElement("div"), list = document.createElement("div");
      plot.className = "plot";
      node.setAttribute("aria-label", `Plot ${panels.length + 1}`);
      list.className = "row";
      node.append(plot, list);
      place.append(node);
      panel = { node, plot, list, spectrum, texts: [] };
      panels.push(panel);
    }
    panel.texts.push(...texts.filter((text) => !panel.texts.includes(text)));
    return fetchInto([panel], quietly);
  }

  async function show(view) {
    for (const panel of [...panels]) close(panel);
    for (const texts of VIEWS[view]) await add(texts, true, view === "vibration", true);
  }

  // The address holds what is shown, so that it can be kept and given on.
  function remember() {
    const mark = (panel) => (panel.spectrum ? "~" : "|");
    const query = new URLSearchParams(panels.flatMap((panel) => panel.texts.map((text, k) => ["signal", k ? text : mark(panel) + text])));
    history.replaceState(null, "", `${location.pathname}${query.size ? `?${query}` : ""}`);
  }

  message.addEventListener("change", async () => {
    fill(field, "Loading …", []);
    if (!message.value) return;
    try {
      const { fields } = await get(`/messages/${encodeURIComponent(message.value)}`);
      fill(field, "Choose a field", fields.map(({ text, unit }) => [unit ? `${text} (${unit})` : text, text]));
    } catch (error) {
      tell(error.message, true);
    }
  });
  field.addEventListener("change", () => { if (field.value) add([field.value], below.checked); });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    if (expression.value.trim()) add([expression.value.trim()], below.checked);
  });

  view.addEventListener("change", () => { if (view.value) show(view.value); });

  function row(...cells) {
    const made = document.createElement("tr");
    made.append(...cells.map((cell) => {
      const box = document.createElement("td");
      box.append(cell);
      return box;
    }));
    return made;
  }

  // A click on what happened shows the ten seconds around it.
  function list() {
    document.getElementById("moments").replaceChildren(...moments.map(({ t, kind, text }) => row(
      button(t.toFixed(2), () => { span = [t - 5, t + 5]; fetchInto(panels); place.scrollIntoView(); }), kind, text)));
  }

  const parameters = document.getElementById("parameters"), wanted = document.getElementById("wanted");
  async function listParameters() {
    const known = await get("/parameters");
    const changed = known.parameters.filter((each) => each.changed);
    document.getElementById("since").textContent = known.before === null
      ? "No flight of this craft before this one is known."
      : `${changed.length} of ${known.parameters.length} were changed since ${known.before}.`;
    const shown = () => {
      const part = wanted.value.trim().toUpperCase();
      parameters.replaceChildren(...(part ? known.parameters.filter(({ name }) => name.includes(part)) : changed.length ? changed : known.parameters)
        .map(({ name, value, before }) => row(name, String(+value.toPrecision(7)), before === null ? "" : String(+before.toPrecision(7)))));
    };
    wanted.oninput = shown;
    shown();
  }
  parameters.closest("details").addEventListener("toggle", ({ target }) => {
    if (target.open && !wanted.oninput) listParameters().catch((error) => tell(error.message, true));
  });

  (async () => {
    try {
      const { messages, moments: found, start, stop } = await get("/messages");
      fill(message, "Choose", messages.map(({ name, rows }) => [`${name} (${rows})`, name]));
      [moments, ends] = [found, [start, stop]];
      list();
      tell("");
    } catch (error) {
      fill(message, "None", []);
      return tell(error.message, true);
    }
    const chosen = JSON.parse(form.dataset.chosen);
    if (!chosen.length) return show(view.value = "attitude");
    const groups = [];
    for (const text of chosen) {
      if (!groups.length || /^[|~]/.test(text)) groups.push([]);
      groups.at(-1).push(text);
    }
    for (const [first, ...rest] of groups) await add([first.replace(/^[|~]/, ""), ...rest], true, first.startsWith("~"));
  })();
})();
