// Explore: panels of signals over one axis of time. What is shown is fetched for the stretch that is shown.
"use strict";

(function () {
  const form = document.getElementById("explore");
  const address = form.dataset.address;
  const message = document.getElementById("message"), field = document.getElementById("field");
  const expression = document.getElementById("expression"), below = document.getElementById("below");
  const state = document.getElementById("explore-state"), place = document.getElementById("plots");
  const COLORS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#b8860b", "#7a5fb5", "#777777"];

  // Each panel: {node, texts, units}. The stretch that all show; null is the whole log.
  const panels = [];
  let span = null, waiting = null, asked = 0;

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

  async function fetchInto(shown) {
    const turn = ++asked;
    const texts = [...new Set(shown.flatMap((panel) => panel.texts))];
    if (!texts.length) return;
    const query = new URLSearchParams(texts.map((text) => ["signal", text]));
    query.set("points", String(Math.min(4000, 2 * Math.max(400, place.clientWidth))));
    if (span) { query.set("start", span[0]); query.set("stop", span[1]); }
    tell("Reading …");
    try {
      const { signals } = await get(`/signals?${query}`);
      if (turn !== asked && shown === panels) return;  // a newer stretch is on its way
      const found = new Map(signals.map((signal) => [signal.text, signal]));
      const problems = signals.filter((signal) => signal.problem);
      for (const panel of shown) {
        panel.texts = panel.texts.filter((text) => !found.get(text)?.problem);
        if (panel.texts.length) draw(panel, panel.texts.map((text) => found.get(text)));
        else close(panel);
      }
      tell(problems.map((signal) => signal.problem).join(" "), problems.length > 0);
      remember();
    } catch (error) {
      tell(error instanceof TypeError ? "The service does not answer." : error.message, true);
    }
  }

  // Text of a log is text, whatever Plotly takes for markup.
  const plain = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;");

  function draw(panel, signals) {
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink").trim() || "#222", grid = style.getPropertyValue("--line").trim() || "#ddd";
    const units = [...new Set(signals.map((signal) => signal.unit))];
    const data = signals.map((signal, k) => ({
      type: "scatter", mode: signal.samples < 60 ? "lines+markers" : "lines", name: plain(signal.text), x: signal.t, y: signal.y,
      line: { width: 1.3, color: COLORS[k % COLORS.length] }, yaxis: units.indexOf(signal.unit) === 0 ? "y" : "y2",
    }));
    const axis = (unit) => ({ title: { text: plain(unit) }, gridcolor: grid, zerolinecolor: grid, automargin: true });
    const layout = {
      height: 300, margin: { l: 60, r: units.length > 1 ? 60 : 14, t: 30, b: 40 }, font: { color: ink }, showlegend: true,
      legend: { orientation: "h", y: 1.02, yanchor: "bottom" }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      xaxis: { title: { text: "time (s)" }, gridcolor: grid, zeroline: false, range: span ?? undefined }, yaxis: axis(units[0]),
      hovermode: "x",
    };
    // A third unit shares the right axis, which then names them all.
    if (units.length > 1) layout.yaxis2 = { ...axis(units.slice(1).join(", ")), overlaying: "y", side: "right", showgrid: false };
    const first = !panel.drawn;
    panel.drawn = true;
    Plotly.react(panel.plot, data, layout, { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d"] });
    if (first) panel.plot.on("plotly_relayout", (change) => zoomed(change));
    panel.list.replaceChildren(...panel.texts.map((text) => {
      const button = document.createElement("button");
      button.type = "button";
      button.className = "plain";
      button.textContent = `Remove ${text}`;
      button.addEventListener("click", () => {
        panel.texts = panel.texts.filter((each) => each !== text);
        if (panel.texts.length) fetchInto([panel]); else { close(panel); remember(); }
      });
      return button;
    }));
  }

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

  function add(text, apart) {
    let panel = panels.at(-1);
    if (!panel || apart) {
      const node = document.createElement("section"), plot = document.createElement("div"), list = document.createElement("div");
      node.setAttribute("aria-label", `Plot ${panels.length + 1}`);
      list.className = "row";
      node.append(plot, list);
      place.append(node);
      panel = { node, plot, list, texts: [] };
      panels.push(panel);
    }
    if (!panel.texts.includes(text)) panel.texts.push(text);
    return fetchInto([panel]);
  }

  // The address holds what is shown, so that it can be kept and given on.
  function remember() {
    const query = new URLSearchParams(panels.flatMap((panel) => panel.texts.map((text, k) => ["signal", k ? text : `|${text}`])));
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
  field.addEventListener("change", () => { if (field.value) add(field.value, below.checked); });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    if (expression.value.trim()) add(expression.value.trim(), below.checked);
  });

  (async () => {
    try {
      const { messages } = await get("/messages");
      fill(message, "Choose", messages.map(({ name, rows }) => [`${name} (${rows})`, name]));
      tell("");
    } catch (error) {
      fill(message, "None", []);
      tell(error.message, true);
    }
    for (const text of JSON.parse(form.dataset.chosen)) await add(text.replace(/^\|/, ""), text.startsWith("|"));
  })();
})();
