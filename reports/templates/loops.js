"use strict";
// Margins and responses of a rate loop for other gains, from the craft's measured response: the formulae of
// sysid/loops/controller.py, filters.py and margins.py, so that page and command agree.
const loops = (() => {
  const data = JSON.parse(document.getElementById("loops").textContent);
  const mul = (a, b) => [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
  const div = (a, b) => {
    const n = b[0] * b[0] + b[1] * b[1];
    return [(a[0] * b[0] + a[1] * b[1]) / n, (a[1] * b[0] - a[0] * b[1]) / n];
  };
  const add = (a, b) => [a[0] + b[0], a[1] + b[1]];
  const scale = (a, k) => [a[0] * k, a[1] * k];
  const abs = (a) => Math.hypot(a[0], a[1]);
  const back = (hz, rate) => [Math.cos(2 * Math.PI * hz / rate), -Math.sin(2 * Math.PI * hz / rate)];

  function firstOrder(hz, rate, cutoff) {
    const dt = 1 / rate, alpha = cutoff > 0 ? dt / (dt + 1 / (2 * Math.PI * cutoff)) : 1;
    return div([alpha, 0], add([1, 0], scale(back(hz, rate), alpha - 1)));
  }
  function secondOrder(hz, rate, cutoff) {
    if (cutoff <= 0 || cutoff >= rate / 2) return [1, 0];
    const ohm = Math.tan(Math.PI * cutoff / rate), c = 1 + Math.SQRT2 * ohm + ohm * ohm, b = ohm * ohm / c;
    const z = back(hz, rate), z2 = mul(z, z);
    const top = add(add([b, 0], scale(z, 2 * b)), scale(z2, b));
    const low = add(add([1, 0], scale(z, 2 * (ohm * ohm - 1) / c)), scale(z2, (1 - Math.SQRT2 * ohm + ohm * ohm) / c));
    return div(top, low);
  }
  // Everything of an axis at one frequency: plant behind the gyro's filters, controller, target path.
  function parts(axis, values, k) {
    const r = axis.response, hz = r.hz[k], rate = axis.loop_rate_hz;
    const z = back(hz, rate), one = add([1, 0], scale(z, -1));
    const gyro = secondOrder(hz, axis.gyro_rate_hz, values.gyro);
    const plant = mul([r.real[k], r.imag[k]], gyro);
    const integral = div([1 / rate, 0], one);
    const slope = mul(scale(one, rate), firstOrder(hz, rate, values.FLTD));
    const pid = add(add([values.P, 0], scale(integral, values.I)), scale(slope, values.D));
    const error = mul(pid, firstOrder(hz, rate, values.FLTE));
    const forward = add([values.FF, 0], scale(one, values.D_FF * rate));
    const target = mul(firstOrder(hz, rate, values.FLTT), add(error, forward));
    // The rate controller sees the angle controller's target a loop later.
    const attitude = div(scale(z, values.angle), mul([0, 2 * Math.PI * hz], mul(gyro, [r.notch_real[k], r.notch_imag[k]])));
    return { plant, error, target, loop: mul(plant, add(error, mul(target, attitude))) };
  }
  function stable(loop) {
    let at = add([1, 0], loop[0]), start = Math.atan2(at[1], at[0]), turning = 0;
    if (start > Math.PI / 3) start -= 2 * Math.PI;
    for (let k = 1; k < loop.length; k++) {
      const next = add([1, 0], loop[k]), turned = div(next, at);
      turning += Math.atan2(turned[1], turned[0]);
      at = next;
    }
    return Math.round((start + turning) / (2 * Math.PI)) === 0;
  }
  function margins(hz, loop) {
    const holds = stable(loop), m = { gain: NaN, phase: NaN, crossover: NaN, rejection: NaN, peak: 0, stable: holds };
    let peak = 0, kept = false, lost = false;
    for (let k = 0; k < loop.length; k++) {
      const s = 1 / abs(add([1, 0], loop[k]));
      peak = Math.max(peak, s);
      if (!lost && s > Math.pow(10, -0.15)) {
        lost = true;
        if (kept) {
          const before = 1 / abs(add([1, 0], loop[k - 1]));
          const w = Math.log(Math.pow(10, -0.15) / before) / Math.log(s / before);
          m.rejection = hz[k - 1] * Math.pow(hz[k] / hz[k - 1], w);
        }
      } else if (!lost) kept = true;
      if (k === 0) continue;
      const a = Math.log(abs(loop[k - 1])), b = Math.log(abs(loop[k])), falls = a >= 0 && b < 0, rises = a < 0 && b >= 0;
      if (falls || rises) {
        const part = a / (a - b), turned = div(loop[k], loop[k - 1]);
        let phase = Math.atan2(-loop[k - 1][1], -loop[k - 1][0]) + part * Math.atan2(turned[1], turned[0]);
        phase = ((phase + Math.PI) % (2 * Math.PI) + 2 * Math.PI) % (2 * Math.PI) - Math.PI;
        phase = phase * 180 / Math.PI;
        if (holds) phase = Math.abs(phase);
        m.phase = Number.isNaN(m.phase) ? phase : Math.min(m.phase, phase);
        if (falls) m.crossover = hz[k - 1] * Math.pow(hz[k] / hz[k - 1], part);
      }
      const i0 = loop[k - 1][1], i1 = loop[k][1], down = i0 < 0 && i1 >= 0, up = i0 >= 0 && i1 < 0;
      if (down || up) {
        const at = loop[k - 1][0] + i0 / (i0 - i1) * (loop[k][0] - loop[k - 1][0]);
        const gain = at < 0 ? -20 * Math.log10(-at) : NaN;
        if (at < 0 && (down || gain > 0)) m.gain = Number.isNaN(m.gain) ? gain : Math.min(m.gain, gain);
      }
    }
    m.peak = 20 * Math.log10(peak);
    return m;
  }
  const sines = new Map(); // of the grid of frequencies, by index of time: the same for every slider
  function stepOf(hz, real) {
    const step = 0.1, t = [], y = [];
    const grid = [], values = [];
    let k = 0;
    for (let f = step / 2; f < 80; f += step) {
      while (k < hz.length - 2 && hz[k + 1] < f) k++;
      let v;
      if (f < hz[0]) v = 1 + (f / hz[0]) ** 2 * (real[0] - 1);
      else if (f > hz[hz.length - 1]) v = real[real.length - 1] * (hz[hz.length - 1] / f) ** 2;
      else v = real[k] + (f - hz[k]) / (hz[k + 1] - hz[k]) * (real[k + 1] - real[k]);
      grid.push(f);
      values.push(v / f);
    }
    for (let n = 0; n <= 80; n++) {
      const at = n * 0.0125;
      if (!sines.has(n)) sines.set(n, Float64Array.from(grid, (f) => Math.sin(2 * Math.PI * f * at)));
      const sine = sines.get(n);
      let sum = 0;
      for (let j = 0; j < grid.length; j++) sum += sine[j] * values[j];
      t.push(at);
      y.push(2 / Math.PI * sum * step);
    }
    return { t, y };
  }
  function quantile(values, q) {
    const known = values.filter((v) => !Number.isNaN(v)).sort((a, b) => a - b);
    return known.length ? known[Math.min(known.length - 1, Math.max(0, Math.round(q * (known.length - 1))))] : NaN;
  }
  function evaluate(axis, values) {
    const r = axis.response, hz = r.hz, all = hz.map((_, k) => parts(axis, values, k));
    const loop = all.map((p) => p.loop), best = margins(hz, loop);
    r.errors ||= r.draws_gain.map((gain, d) => gain.map((size, k) => {
      const phase = r.draws_phase[d][k];
      return [Math.exp(size) * Math.cos(phase), Math.exp(size) * Math.sin(phase)];
    }));
    const draws = r.errors.map((error) => loop.map((l, k) => mul(l, error[k])));
    const drawn = draws.map((one) => margins(hz, one)), band = {};
    for (const name of ["gain", "phase", "crossover", "rejection", "peak"])
      band[name] = [quantile(drawn.map((m) => m[name]), 0.025), quantile(drawn.map((m) => m[name]), 0.975)];
    const closed = all.map((p) => div(mul(p.plant, p.target), add([1, 0], mul(p.plant, p.error)))[0]);
    const unstable = drawn.filter((m) => !m.stable).length / drawn.length;
    return { hz, loop, draws, best, band, unstable, step: stepOf(hz, closed) };
  }

  function plot(canvas, title, x, lines, logX, limits) {
    const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth || 400, h = canvas.clientHeight || 240;
    canvas.width = w * ratio;
    canvas.height = h * ratio;
    const c = canvas.getContext("2d");
    c.scale(ratio, ratio);
    c.clearRect(0, 0, w, h);
    const ink = getComputedStyle(document.body).color;
    const fx = logX ? Math.log : (v) => v, x0 = fx(x[0]), x1 = fx(x[x.length - 1]);
    const px = (v) => 44 + (w - 52) * (fx(v) - x0) / (x1 - x0);
    const py = (v) => 22 + (h - 46) * (limits[1] - Math.min(Math.max(v, limits[0]), limits[1])) / (limits[1] - limits[0]);
    c.font = "12px sans-serif";
    c.fillStyle = ink;
    c.fillText(title, 44, 14);
    c.strokeStyle = "rgba(128,128,128,.35)";
    const parts = logX ? 4 : 5;
    for (let n = 0; n <= parts; n++) {
      const v = limits[0] + n * (limits[1] - limits[0]) / parts;
      c.beginPath();
      c.moveTo(44, py(v));
      c.lineTo(w - 8, py(v));
      c.stroke();
      c.fillText(v.toFixed(limits[1] - limits[0] > 10 ? 0 : 1), 4, py(v) + 4);
    }
    const ticks = logX ? [0.5, 1, 2, 5, 10, 20, 40] : [0, 0.25, 0.5, 0.75, 1];
    for (const v of ticks) if (v >= x[0] && v <= x[x.length - 1]) c.fillText(String(v), px(v) - 6, h - 6);
    for (const line of lines) {
      c.strokeStyle = line.colour;
      c.lineWidth = line.width;
      c.beginPath();
      line.y.forEach((v, k) => (k ? c.lineTo(px(x[k]), py(v)) : c.moveTo(px(x[k]), py(v))));
      c.stroke();
    }
  }
  const colours = { band: "rgba(70,120,200,.18)", now: "#2458b3", flown: "rgba(150,90,20,.9)" };
  function draw(axis, flown, now) {
    const find = (kind) => document.querySelector(`canvas[data-axis="${axis.axis}"][data-plot="${kind}"]`);
    const gain = (loop) => loop.map((l) => 20 * Math.log10(abs(l)));
    const phase = (loop) => {
      let before = null;
      return loop.map((l) => {
        let v = Math.atan2(l[1], l[0]) * 180 / Math.PI;
        if (before !== null) v += 360 * Math.round((before - v) / 360);
        else if (v > 60) v -= 360;
        before = v;
        return v;
      });
    };
    const lost = (loop) => loop.map((l) => -20 * Math.log10(abs(add([1, 0], l))));
    const set = (f) => [
      ...now.draws.map((d) => ({ y: f(d), colour: colours.band, width: 1 })),
      { y: f(flown.loop), colour: colours.flown, width: 1.5 },
      { y: f(now.loop), colour: colours.now, width: 2 },
    ];
    plot(find("gain"), "Broken loop, gain (dB) over Hz; brown: as flown", now.hz, set(gain), true, [-30, 30]);
    plot(find("phase"), "Broken loop, phase (deg)", now.hz, set(phase), true, [-360, 0]);
    plot(find("sensitivity"), "Disturbances: sensitivity (dB)", now.hz, set(lost), true, [-40, 20]);
    plot(find("step"), "Rate after a step of its target, over s", now.step.t, [
      { y: flown.step.y, colour: colours.flown, width: 1.5 }, { y: now.step.y, colour: colours.now, width: 2 },
    ], false, [-0.5, 2]);
  }
  function tell(axis, now) {
    const place = document.querySelector(`.loop-margins[data-axis="${axis.axis}"]`);
    const text = (title, name, unit, digits) => {
      const v = now.best[name];
      if (Number.isNaN(v)) return `${title} beyond the band`;
      const [low, high] = now.band[name];
      return `${title} ${v.toFixed(digits)} ${unit} (${low.toFixed(digits)} to ${high.toFixed(digits)})`;
    };
    place.className = "loop-margins" + (now.best.stable && now.unstable === 0 ? "" : " loop-bad");
    const verdict = now.best.stable ? (now.unstable > 0 ? "Perhaps UNSTABLE. " : "") : "UNSTABLE. ";
    place.textContent = verdict + [
      text("gain margin", "gain", "dB", 1), text("phase margin", "phase", "deg", 0),
      text("crossover", "crossover", "Hz", 1), text("rejection to", "rejection", "Hz", 1), text("peak", "peak", "dB", 1),
    ].join("; ") + ".";
  }
  function start() {
    for (const item of data.axes) {
      if (!item.flown) continue;
      const axis = item.flown, letters = { roll: "RLL", pitch: "PIT", yaw: "YAW" }[axis.axis];
      const named = (p) => ({
        P: p[`ATC_RAT_${letters}_P`], I: p[`ATC_RAT_${letters}_I`], D: p[`ATC_RAT_${letters}_D`],
        FF: p[`ATC_RAT_${letters}_FF`], D_FF: p[`ATC_RAT_${letters}_D_FF`], FLTT: p[`ATC_RAT_${letters}_FLTT`],
        FLTE: p[`ATC_RAT_${letters}_FLTE`], FLTD: p[`ATC_RAT_${letters}_FLTD`],
        angle: p[`ATC_ANG_${letters}_P`], gyro: p.INS_GYRO_FILTER,
      });
      const before = named(axis.parameters), flown = evaluate(axis, before);
      const values = item.tuned ? named(item.tuned.parameters) : { ...before };
      const show = () => {
        const now = evaluate(axis, values);
        tell(axis, now);
        draw(axis, flown, now);
      };
      const box = document.querySelector(`.loop-sliders[data-axis="${axis.axis}"]`);
      for (const [name, title] of [["P", "P"], ["I", "I"], ["D", "D"], ["FLTD", "FLTD (Hz)"], ["FLTT", "FLTT (Hz)"],
        ["FLTE", "FLTE (Hz)"], ["FF", "FF"], ["angle", "angle P"], ["gyro", "INS_GYRO_FILTER (Hz)"]]) {
        if (!(before[name] > 0)) continue;
        const label = document.createElement("label"), slider = document.createElement("input");
        const shown = document.createElement("span");
        slider.type = "range";
        slider.min = "-1";
        slider.max = "1";
        slider.step = "0.01";
        slider.value = String(Math.log2(values[name] / before[name]));
        slider.dataset.name = name;
        const write = () => { shown.textContent = `${title} ${values[name].toPrecision(4)}`; };
        slider.addEventListener("input", () => {
          values[name] = before[name] * Math.pow(2, Number(slider.value));
          write();
          show();
        });
        write();
        label.append(shown, slider);
        box.append(label);
      }
      show();
    }
  }
  start();
  return { evaluate, data };
})();
