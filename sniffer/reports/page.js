// A read-out under the pointer, and a closer look: drag over a stretch of time, "whole time" ends it.
"use strict";
(() => {
  const blocks = [...document.querySelectorAll(".tracks")];
  if (!document.querySelector(".tracks .plot svg")) return;
  const size = Number(blocks[0].dataset.size);
  const width = Number(blocks[0].dataset.width);
  const whole = document.getElementById("whole");
  const steps = whole.dataset.steps.split(" ").map(Number);
  const HEIGHT = document.querySelector(".tracks .plot svg").viewBox.baseVal.height;
  let from = 0;
  let to = size;

  // The points of a path of M, l, h and v: x in buckets, y in steps of the axis.
  const points = (path) => {
    const out = [];
    let x = 0;
    let y = 0;
    for (const [, command, rest] of path.matchAll(/([MlhvVz])([^MlhvVz]*)/g)) {
      const numbers = (rest.match(/-?[\d.]+/g) || []).map(Number);
      if (command === "M") [x, y] = numbers;
      else if (command === "h") x += numbers[0];
      else if (command === "v") y += numbers[0];
      for (let k = 0; command === "l" && k + 1 < numbers.length; k += 2) {
        x += numbers[k];
        y += numbers[k + 1];
        out.push([x, y]);
      }
      if (command !== "l") out.push([x, y]);
    }
    return out;
  };
  const label = (s) => {
    const pad = (n) => String(Math.floor(n)).padStart(2, "0");
    if (s < 120) return `${Number(s.toFixed(3))} s`;
    if (s < 7200 && s % 60 < 0.5) return `${Math.floor(s / 60)} min`;
    if (s < 7200) return `${Math.floor(s / 60)}:${pad(s % 60)} min`;
    return `${Math.floor(s / 3600)}:${pad((s % 3600) / 60)} h`;
  };

  const drawings = blocks.flatMap((block) => [...block.querySelectorAll(".plot svg")]);
  const lines = new Map();
  const known = (svg) => {
    if (!lines.has(svg)) {
      const of = [...svg.querySelectorAll("path.line")];
      lines.set(svg, of.map((p) => [p.classList[1], points(p.getAttribute("d"))]));
    }
    return lines.get(svg);
  };
  const told = (svg, x) => {
    const low = Number(svg.dataset.low);
    const high = Number(svg.dataset.high);
    return known(svg).map(([name, all]) => {
      let i = 0;
      for (let a = 0, b = all.length - 1; a <= b;) {
        const middle = (a + b) >> 1;
        if (all[middle][0] <= x) { i = middle; a = middle + 1; } else b = middle - 1;
      }
      if (!all.length || all[i][0] > x + 1) return "";
      const value = high - (all[i][1] / HEIGHT) * (high - low);
      return `${name} ${Number(value.toPrecision(4))}`;
    }).filter(Boolean).join(", ");
  };

  const show = () => {
    for (const svg of drawings) svg.setAttribute("viewBox", `${from} 0 ${to - from} ${HEIGHT}`);
    const seconds = (to - from) * width;
    const step = steps.find((s) => seconds / s <= 8) || steps.at(-1);
    for (const block of blocks) {
      const axis = block.querySelector(":scope > .times");
      axis.replaceChildren();
      for (let k = Math.ceil((from * width) / step); k * step <= to * width; k++) {
        const span = document.createElement("span");
        span.textContent = label(k * step);
        const at = ((k * step / width - from) / (to - from)) * 100;
        if (at > 95) span.className = "last";
        span.style.left = `${at}%`;
        axis.append(span);
      }
      for (const mark of block.querySelectorAll(".mark")) {
        const bar = mark.querySelector(".bar");
        const sign = mark.querySelector("a");
        mark.dataset.at ??= parseFloat(bar.style.left);
        mark.dataset.long ??= parseFloat(bar.style.width);
        const place = (share) => ((share / 100 * size - from) / (to - from)) * 100;
        const left = place(Number(mark.dataset.at));
        bar.style.left = `${left}%`;
        bar.style.width = `${Number(mark.dataset.long) * size / (to - from)}%`;
        const late = left > 70;
        sign.style.left = late ? "auto" : `${left}%`;
        sign.style.right = late ? `${100 - left}%` : "auto";
      }
    }
    whole.hidden = from === 0 && to === size;
  };

  let start = null;
  const bucket = (svg, event) => {
    const box = svg.getBoundingClientRect();
    const share = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
    return from + share * (to - from);
  };
  const cursor = (svg, x) => {
    let line = svg.querySelector(".cursor");
    if (!line) {
      line = document.createElementNS(svg.namespaceURI, "line");
      line.setAttribute("class", "cursor");
      line.setAttribute("y1", "0");
      line.setAttribute("y2", String(HEIGHT));
      svg.append(line);
    }
    line.setAttribute("x1", x);
    line.setAttribute("x2", x);
  };
  for (const block of blocks) {
    const own = [...block.querySelectorAll(".plot svg")];
    for (const svg of own) {
      svg.style.touchAction = "pan-y";
      svg.addEventListener("pointermove", (event) => {
        const x = bucket(svg, event);
        for (const other of own) {
          cursor(other, x);
          other.closest("figure").querySelector("output").textContent = told(other, x);
        }
        own[0].closest("figure").querySelector("output").textContent =
          `${label(x * width)}: ${told(own[0], x)}`;
      });
      svg.addEventListener("pointerdown", (event) => { start = [svg, bucket(svg, event)]; });
      svg.addEventListener("pointerup", (event) => {
        if (!start || start[0] !== svg) return;
        const ends = [start[1], bucket(svg, event)].sort((a, b) => a - b);
        start = null;
        if (ends[1] - ends[0] < Math.max((to - from) / 50, 2)) return;
        from = Math.floor(ends[0]);
        to = Math.ceil(ends[1]);
        show();
      });
    }
  }
  whole.addEventListener("click", () => { from = 0; to = size; show(); });
})();
