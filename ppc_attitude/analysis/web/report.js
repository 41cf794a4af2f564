// Figures of a report that can be zoomed and read off, and the replay of the attitude.
"use strict";

const numbers = (text, Form = Float32Array) =>
  new Form(Uint8Array.from(atob(text), (each) => each.charCodeAt(0)).buffer);
const make = (name, parent, text = "") => {
  const element = parent.appendChild(document.createElement(name));
  element.textContent = text;
  return element;
};

// A click on a button under a figure shows it as charts: drag to zoom, double click to go back.
function chart(box, panel, sync) {
  const tables = panel.lines.map((line) => {
    const y = Array.from(numbers(line.y), (each) =>
      Number.isNaN(each) || (panel.scale === "log" && each <= 0) ? null : each);
    return [Array.from(numbers(line.x, Float64Array)), y];
  });
  const distribution = { linear: 1, log: 3, symlog: 4 }[panel.scale];
  const [least, most] = panel.limits || [-Infinity, Infinity];
  // As much as there is to see of the part that is shown, within the limits of the drawing.
  const range = (_, low, high) => {
    if (low == null) return [null, null];
    const inside = low < most && high > least;
    const [from, to] = inside ? [Math.max(low, least), Math.min(high, most)] : [low, high];
    const log = distribution === 3;
    return log ? uPlot.rangeLog(from, to, 10, false) : uPlot.rangeNum(from, to, 0.1, true);
  };
  const bands = ({ ctx, bbox, valToPos }) => panel.bands.forEach((band) => {
    const [from, to] = [band.from, band.to].map((each) =>
      Math.min(Math.max(valToPos(each, "x", true), bbox.left), bbox.left + bbox.width));
    ctx.fillStyle = band.colour;
    ctx.fillRect(from, bbox.top, to - from, bbox.height);
  });
  new uPlot({
    hooks: { drawClear: [bands] },
    // So high that the axis title is not cut.
    width: box.clientWidth, height: Math.max(260, 7.8 * panel.label.length), cursor: { sync: { key: sync } },
    scales: { x: { time: false }, y: { distr: distribution, range } },
    axes: [{ label: "time [s]" }, {
      label: panel.label, labelFont: "12px sans-serif", size: 70,
      values: (_, ticks) => ticks.map((each) => each == null ? "" : String(+each.toPrecision(3))),
    }],
    series: [{ label: "t [s]" }, ...panel.lines.map((line) => ({
      label: line.label, stroke: line.colour, dash: line.dashed ? [6, 4] : [], width: 1,
      class: line.label ? "told" : "untold", points: { show: false },
      value: (_, value) => (value == null ? "–" : value.toPrecision(4)),
    }))],
  }, uPlot.join(tables, tables.map(() => [2])), box);
}

document.querySelectorAll("figure > script").forEach((data, index) => {
  const figure = data.parentElement, image = figure.querySelector("img");
  const button = make("button", figure, "zoom and read off");
  const box = make("div", figure);
  box.hidden = true;
  button.onclick = () => {
    box.hidden = !box.hidden;
    image.hidden = !box.hidden;
    figure.classList.toggle("page", !box.hidden || figure.dataset.width === "page");
    button.textContent = box.hidden ? "zoom and read off" : "back to the drawing";
    if (!box.childElementCount) {
      JSON.parse(data.textContent).forEach((panel) => chart(box, panel, `figure${index}`));
    }
  };
});

// Quaternions are x y z w; the picture's axes: x to the right, y up, z to the viewer.
const rotate = (q, v) => {
  const [x, y, z, w] = q, [a, b, c] = v;
  const s = [y * c - z * b, z * a - x * c, x * b - y * a].map((each) => 2 * each);
  return [a + w * s[0] + y * s[2] - z * s[1], b + w * s[1] + z * s[0] - x * s[2],
    c + w * s[2] + x * s[1] - y * s[0]];
};

document.querySelectorAll(".replay").forEach((place) => {
  const data = JSON.parse(place.querySelector("script").textContent);
  const t = numbers(data.t, Float64Array), columns = {};
  for (const [name, text] of Object.entries(data.columns)) columns[name] = numbers(text);
  const row = (name, width, k) => columns[name] && columns[name].slice(width * k, width * (k + 1));
  const canvas = make("canvas", place), controls = make("div", place);
  const play = make("button", controls, "play"), slider = make("input", controls);
  const told = make("span", controls);
  Object.assign(slider, { type: "range", min: 0, max: t.length - 1, value: 0 });
  Object.assign(canvas, { width: 640, height: 420 });
  const context = canvas.getContext("2d");
  let [turn, tilt] = [-0.7, 0.5];
  const seen = ([x, y, z]) => {
    const a = x * Math.cos(turn) - y * Math.sin(turn), b = x * Math.sin(turn) + y * Math.cos(turn);
    const up = z * Math.cos(tilt) - b * Math.sin(tilt);
    return [320 + 120 * a, 210 - 120 * up];
  };
  const line = (from, to, colour, width, dash = []) => {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.setLineDash(dash);
    context.beginPath();
    context.moveTo(...seen(from));
    context.lineTo(...seen(to));
    context.stroke();
  };
  const colours = ["#0072B2", "#D55E00", "#009E73"];
  const longest = 1.7 / Math.hypot(1, 1, 1);  // with all axes at their limit the arrow fits
  const known = (quaternion) => quaternion && quaternion.some((each) => each);  // else zeros
  const unit = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  const draw = () => {
    const k = Number(slider.value), attitude = row("attitude", 4, k);
    context.clearRect(0, 0, canvas.width, canvas.height);
    const reference = row("reference", 4, k), torque = row("torque", 3, k);
    if (known(reference)) {
      unit.forEach((axis, j) =>
        line([0, 0, 0], rotate(reference, axis.map((e) => 1.5 * e)), colours[j], 1, [4, 4]));
    }
    let text = ", no attitude on record";
    if (known(attitude)) {
      craft(attitude, torque);
      text = torque ? `, torque ${[...torque].map((e) => e.toPrecision(3)).join(", ")} N·m` : "";
    }
    told.textContent = ` ${t[k].toFixed(2)} s${text}`;
  };
  const craft = (attitude, torque) => {
    const corner = (bits) => rotate(attitude, [0.45, 0.3, 0.6].map((e, j) => (bits >> j & 1 ? e : -e)));
    for (let a = 0; a < 8; a++) {
      for (const bit of [1, 2, 4]) if (!(a & bit)) line(corner(a), corner(a | bit), "#444", 1.2);
    }
    unit.forEach((axis, j) => {
      const tip = rotate(attitude, axis.map((e) => 1.2 * e));
      line([0, 0, 0], tip, colours[j], 2.5);
      context.fillStyle = colours[j];
      context.fillText("xyz"[j], ...seen(tip));
    });
    if (torque) {
      line([0, 0, 0], rotate(attitude, [...torque].map((e) => e * longest / data.torque_limit)), "#000", 3);
    }
  };
  let timer = 0;
  play.onclick = () => {
    clearInterval(timer);
    timer = timer ? 0 : setInterval(() => {
      slider.value = (Number(slider.value) + 1) % t.length;
      draw();
    }, 30);
    play.textContent = timer ? "pause" : "play";
  };
  slider.oninput = draw;
  canvas.onpointermove = (event) => {
    if (!event.buttons) return;
    turn += event.movementX / 100;
    tilt += event.movementY / 100;
    draw();
  };
  draw();
});
