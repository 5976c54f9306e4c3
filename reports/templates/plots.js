// Draws the figures of the page when they come into view, in the colours of the theme, with one shared time axis.
"use strict";
(function () {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const byId = new Map(figures.map((figure) => [figure.id, figure]));
  // A place in the page shows one of its figures; most have only one.
  const places = new Map();
  for (const figure of figures) if (!places.has(figure.place)) places.set(figure.place, figure.id);
  const drawn = new Set();
  // On paper plots are as wide as a page of A4 or Letter is between its margins.
  const PRINT_WIDTH = 670, PRINT_HEIGHT = 460;
  let timeRange = null;
  let following = false;
  let printing = false;

  const elementOf = (place) => document.getElementById("plot-" + place);
  const shownAt = (place) => byId.get(places.get(place));

  async function unzip(text) {
    const bytes = atob(text), packed = new Uint8Array(bytes.length);
    for (let k = 0; k < bytes.length; k++) packed[k] = bytes.charCodeAt(k);  // a tenth of the time of Uint8Array.from
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  }

  // Figures travel gzipped, long lines as differences of whole numbers.
  async function unpack(figure) {
    if (figure.data) return figure;
    const { data, layout } = JSON.parse(await unzip(figure.packed));
    for (const trace of data) for (const axis of ["x", "y"]) if (trace[axis]?.deltas) trace[axis] = undo(trace[axis]);
    return Object.assign(figure, { data, layout });
  }

  function undo({ scale, deltas }) {
    const values = new Float64Array(deltas.length);
    let sum = 0;
    deltas.forEach((delta, k) => { values[k] = delta === null ? NaN : (sum += delta) / scale; });
    return values;
  }

  function themed(value) {
    if (typeof value === "string" && /^@[a-z]+[0-9]?$/.test(value)) {
      return getComputedStyle(document.documentElement).getPropertyValue("--" + value.slice(1)).trim();
    }
    if (ArrayBuffer.isView(value)) return value;
    // Of numbers alone, but for the ends of a scale of colours.
    if (Array.isArray(value)) return typeof value[0] === "number" && typeof value[1] !== "string" ? value : value.map(themed);
    if (value && typeof value === "object") {
      return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, themed(item)]));
    }
    return value;
  }

  // Names above a plot, the first the most important, as many as do not cover each other at this width.
  function apart(names, [begin, end], width) {
    const taken = [], letter = 6.6 * (end - begin) / width;
    return names.filter(({ x, xanchor, text, yref, yanchor }) => {
      if (yref !== "paper" || yanchor !== "bottom") return true;
      const room = letter * text.length, from = xanchor === "right" ? x - room : x;
      const free = from + room <= end + 2 * letter && taken.every(([start, stop]) => from >= stop || from + room <= start);
      if (free) taken.push([from, from + room]);
      return free;
    });
  }

  function layoutOf(figure, element) {
    const layout = themed(figure.layout);
    layout.height = figure.height;
    if (layout.annotations && layout.xaxis?.range) {
      const width = (element.clientWidth || PRINT_WIDTH) - layout.margin.l - layout.margin.r;
      layout.annotations = apart(layout.annotations, timeRange?.range ?? layout.xaxis.range, width);
    }
    if (groupsOf(figure).length > 1 && !printing) layout.showlegend = false;  // the boxes above the plot are it
    if (printing) {
      layout.width = Math.min(PRINT_WIDTH, element.clientWidth || PRINT_WIDTH);
      // Several small plots above each other: lower ones leave fewer pages half empty.
      if (layout.height > PRINT_HEIGHT) layout.height = Math.max(PRINT_HEIGHT, 0.8 * layout.height);
    }
    layout.dragmode = matchMedia("(pointer: coarse)").matches ? false : "zoom";
    if (figure.time && timeRange) layout.xaxis = Object.assign({}, layout.xaxis, timeRange);
    return layout;
  }

  function draw(place) {
    const element = elementOf(place), figure = shownAt(place), first = !drawn.has(place);
    if (!figure.data) return;
    if (first) { element.textContent = ""; element.classList.remove("waiting"); element.style.height = ""; }
    drawn.add(place);
    Plotly.react(element, themed(figure.data), layoutOf(figure, element), { responsive: !printing, displaylogo: false, displayModeBar: false });
    if (first) {
      element.on("plotly_relayout", (change) => { if (shownAt(place).time) follow(place, change); });
      offerChoice(place, element);
    }
  }

  const groupsOf = (figure) => [...new Set(figure.data.map((trace) => trace.legendgroup).filter(Boolean))];

  // The legend, with boxes for the keyboard, for fingers and for screen readers.
  function offerChoice(place, element) {
    const groups = groupsOf(shownAt(place));
    if (groups.length < 2) return;
    const choice = document.createElement("fieldset");
    choice.className = "choice";
    const legend = document.createElement("legend");
    legend.textContent = "Shown";
    choice.append(legend);
    const members = (group) => shownAt(place).data.flatMap((trace, index) => (trace.legendgroup === group ? [index] : []));
    const isShown = (group) => members(group).some((index) => shownAt(place).data[index].visible !== "legendonly");
    for (const group of groups) {
      const label = document.createElement("label"), box = document.createElement("input");
      box.type = "checkbox";
      box.checked = isShown(group);
      box.addEventListener("change", () => {
        Plotly.restyle(element, { visible: box.checked ? true : "legendonly" }, members(group));
      });
      element.on("plotly_restyle", () => {
        for (const index of members(group)) if (element.data[index]) shownAt(place).data[index].visible = element.data[index].visible;
        box.checked = isShown(group);
      });
      const drawing = element.data[members(group)[0]], swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = drawing.line?.color ?? drawing.marker?.color ?? "none";
      label.append(box, swatch, group);
      choice.append(label);
    }
    element.before(choice);
  }

  // What is shown of one flight stays shown of the next.
  function keepShown(from, to) {
    const visible = new Map(from.data.filter((trace) => trace.legendgroup).map((trace) => [trace.legendgroup, trace.visible]));
    for (const trace of to.data) if (visible.has(trace.legendgroup)) trace.visible = visible.get(trace.legendgroup);
  }

  // A choice is of one place, or of several that show the same thing in different ways: PLACE-VALUE.
  async function choose(select) {
    const several = select.dataset.places?.split(" ") ?? [];
    const link = select.parentElement.parentElement.querySelector("a");
    if (link) link.href = select.selectedOptions[0].dataset.page;
    if (!several.length) return put(select.dataset.place, byId.get(select.value));
    await Promise.all(several.map((place) => put(place, byId.get(`${place}-${select.value}`))));
  }

  async function put(place, after) {
    if (!after) return;
    const before = shownAt(place);
    await unpack(after);
    if (before.data && before !== after) keepShown(before, after);
    places.set(place, after.id);
    if (!drawn.has(place)) return;
    draw(place);
    const element = elementOf(place);
    if (element.previousElementSibling?.matches(".choice")) element.previousElementSibling.remove();
    offerChoice(place, element);
  }

  // Zooming one time axis zooms all; a double click shows everything again.
  function follow(source, change) {
    if (following) return;
    if (change["xaxis.range[0]"] !== undefined) {
      timeRange = { range: [change["xaxis.range[0]"], change["xaxis.range[1]"]], autorange: false };
    } else if (change["xaxis.autorange"] || change["xaxis.range"]) {
      timeRange = change["xaxis.range"] ? { range: change["xaxis.range"], autorange: false } : null;
    } else {
      return;
    }
    following = true;
    const others = [...drawn].filter((place) => place !== source && shownAt(place).time);
    Promise.all(others.map((place) =>
      Plotly.relayout(elementOf(place), timeRange
        ? { "xaxis.range": timeRange.range.slice() }
        : { "xaxis.range": shownAt(place).layout.xaxis.range.slice() }))).finally(() => { following = false; });
  }

  // What is folded away is not printed, and has no size to be drawn at. Paper is light whatever the screen is.
  function print(begins) {
    printing = begins;
    document.documentElement.classList.toggle("printing", begins);
    for (const place of places.keys()) if (begins ? elementOf(place).checkVisibility() : drawn.has(place)) draw(place);
  }

  function start() {
    // One after the other, from the top: the first is seen before the next takes its time.
    let before = Promise.resolve();
    const shown = () => new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
    const watcher = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        if (!entry.isIntersecting) continue;
        watcher.unobserve(entry.target);
        const place = entry.target.id.slice("plot-".length);
        before = before.then(() => unpack(shownAt(place))).then(() => draw(place)).then(shown);
      }
    }, { rootMargin: "600px" });
    for (const place of places.keys()) watcher.observe(elementOf(place));
    document.querySelectorAll("select[data-place], select[data-places]").forEach((select) => {
      select.addEventListener("change", () => choose(select));
      // The browser may have remembered a choice.
      if (select.selectedIndex > 0 || (select.dataset.place && select.value !== places.get(select.dataset.place))) choose(select);
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => drawn.forEach(draw));
    addEventListener("beforeprint", () => print(true));
    addEventListener("afterprint", () => print(false));
    // Printing does not wait: what may have to be drawn for it must be unpacked by then.
    return Promise.all([...places.values()].map((id) => unpack(byId.get(id))));
  }

  // Plotly lies in a file beside the pages of a folder, or travels gzipped inside the page: a third of its size, and no
  // network is needed.
  async function loadPlotly() {
    if (window.Plotly) return;
    if (!document.getElementById("plotly")) throw new Error("no file");
    const script = document.createElement("script");
    script.textContent = await unzip(document.getElementById("plotly").textContent.trim());
    document.head.append(script);
  }

  // A page that prints itself, without a person who waits, does so once it has loaded: an open frame keeps it loading
  // until the plots can be drawn. In a sandbox, as the service shows reports, no page has a hold on its frames.
  function holdLoad() {
    const frame = document.createElement("iframe");
    frame.hidden = true;
    document.body.append(frame);
    frame.contentDocument?.open();
    return () => { frame.contentDocument?.close(); frame.remove(); };
  }

  if (!figures.length) return;
  const release = holdLoad();
  loadPlotly().then(start).finally(release).catch(() => {
    const apart = !document.getElementById("plotly");
    document.querySelectorAll(".plot").forEach((element) => {
      if (element.querySelector(".main-svg")) return;
      element.textContent = apart ? "The plots are drawn by plotly.min.js, which lies beside the report on all flights: this page was moved away from it. The tables are complete." : "This browser is too old to draw the plots; the tables are complete, and a browser of 2023 or later draws the plots.";
      element.classList.add("no-script");
    });
  });
})();
