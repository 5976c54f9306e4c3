// Draws the figures of the page when they come into view, in the colours of the theme, with one shared time axis.
"use strict";
(function () {
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const drawn = new Set();
  let timeRange = null;
  let following = false;

  function themed(value) {
    if (typeof value === "string" && /^@[a-z]+[0-9]?$/.test(value)) {
      return getComputedStyle(document.documentElement).getPropertyValue("--" + value.slice(1)).trim();
    }
    if (Array.isArray(value)) return typeof value[0] === "number" ? value : value.map(themed);
    if (value && typeof value === "object") {
      return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, themed(item)]));
    }
    return value;
  }

  function layoutOf(figure) {
    const layout = themed(figure.layout);
    layout.height = figure.height;
    layout.dragmode = matchMedia("(pointer: coarse)").matches ? false : "zoom";
    if (figure.time && timeRange) layout.xaxis = Object.assign({}, layout.xaxis, timeRange);
    return layout;
  }

  function draw(figure) {
    const element = document.getElementById("plot-" + figure.id);
    const first = !drawn.has(figure.id);
    if (first) { element.textContent = ""; element.classList.remove("waiting"); }
    drawn.add(figure.id);
    Plotly.react(element, themed(figure.data), layoutOf(figure), { responsive: true, displaylogo: false, displayModeBar: false });
    if (first && figure.time) element.on("plotly_relayout", (change) => follow(figure, change));
    if (first) offerChoice(figure, element);
  }

  // What a click into the legend does, for the keyboard, for fingers and for screen readers as well.
  function offerChoice(figure, element) {
    const groups = [...new Set(figure.data.map((trace) => trace.legendgroup).filter(Boolean))];
    if (groups.length < 2) return;
    const choice = document.createElement("fieldset");
    choice.className = "choice";
    const legend = document.createElement("legend");
    legend.textContent = "Shown";
    choice.append(legend);
    for (const group of groups) {
      const label = document.createElement("label"), box = document.createElement("input");
      const members = figure.data.flatMap((trace, index) => (trace.legendgroup === group ? [index] : []));
      const isShown = () => element.data[members[0]].visible !== "legendonly";
      box.type = "checkbox";
      box.checked = isShown();
      box.addEventListener("change", () => {
        Plotly.restyle(element, { visible: box.checked ? true : "legendonly" }, members);
      });
      element.on("plotly_restyle", () => {
        box.checked = isShown();
        for (const index of members) figure.data[index].visible = element.data[index].visible;
      });
      label.append(box, " ", group);
      choice.append(label);
    }
    element.before(choice);
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
    const others = figures.filter((figure) => figure.time && figure.id !== source.id && drawn.has(figure.id));
    Promise.all(others.map((figure) =>
      Plotly.relayout("plot-" + figure.id, timeRange
        ? { "xaxis.range": timeRange.range.slice() }
        : { "xaxis.range": figure.layout.xaxis.range.slice() }))).finally(() => { following = false; });
  }

  // What is folded away is not printed, and has no size to be drawn at.
  function drawAll() {
    figures.filter((figure) => document.getElementById("plot-" + figure.id).offsetParent).forEach(draw);
  }

  function start() {
    const watcher = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        if (!entry.isIntersecting) continue;
        watcher.unobserve(entry.target);
        draw(figures.find((figure) => "plot-" + figure.id === entry.target.id));
      }
    }, { rootMargin: "600px" });
    figures.forEach((figure) => watcher.observe(document.getElementById("plot-" + figure.id)));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      figures.filter((figure) => drawn.has(figure.id)).forEach(draw);
    });
    addEventListener("beforeprint", drawAll);
  }

  // Plotly lies in a file beside the pages of a folder, or travels gzipped inside the page: a third of its size, and no
  // network is needed.
  async function loadPlotly() {
    if (window.Plotly) return;
    if (!document.getElementById("plotly")) throw new Error("no file");
    const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent.trim()), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
  }

  if (!figures.length) return;
  loadPlotly().then(start).catch(() => {
    const apart = !document.getElementById("plotly");
    document.querySelectorAll(".plot").forEach((element) => {
      element.textContent = apart ? "The plots are drawn by plotly.min.js, which lies beside the report on all flights: this page was moved away from it. The tables are complete." : "This browser is too old to draw the plots; the tables are complete, and a browser of 2023 or later draws the plots.";
      element.classList.add("no-script");
    });
  });
})();
