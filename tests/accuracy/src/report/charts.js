// Charts as inline SVG. Every function returns text.
"use strict";

const clean = (text) => String(text).replace(/[&<>"]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[c]);

// Three significant digits, without trailing zeros, and exponents only for extreme values.
function short(x) {
  if (x === null || x === undefined || Number.isNaN(x)) return "–";
  if (x === 0) return "0";
  const size = Math.abs(x);
  if (size >= 1e6 || size < 1e-4) return x.toExponential(1).replace("e", "·10^").replace("^+", "^").replace(/\^(-?\d+)/, (_, n) => superscript(n));
  if (size >= 100) return x.toFixed(0);
  return String(Number(x.toPrecision(3)));
}

function superscript(digits) {
  return [...digits].map((d) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[d] ?? "⁻").join("");
}

function bytes(n) {
  return n >= 1e6 ? `${(n / 1e6).toFixed(2)} MB` : `${(n / 1e3).toFixed(0)} kB`;
}

// A logarithmic axis for positive values: `at` maps to 0..1, `ticks` are round numbers.
function logAxis(values, least) {
  const positive = values.filter((v) => v > 0);
  let low = Math.min(...positive), high = Math.max(...positive);
  if (!positive.length) { low = least; high = 10 * least; }
  const span = Math.max(Math.log10(high / low), 0.5), middle = Math.log10(low * high) / 2;
  const from = middle - span * 0.5 - span * 0.09, to = middle + span * 0.5 + span * 0.09;
  const ticks = [];
  const steps = to - from > 3.5 ? [1] : to - from > 1.3 ? [1, 3] : to - from > 0.8 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 6, 8];
  for (let decade = Math.floor(from) - 1; decade <= Math.ceil(to); decade++) {
    for (const step of steps) {
      const value = step * 10 ** decade, at = Math.log10(value);
      if (at >= from && at <= to) ticks.push(value);
    }
  }
  return { at: (v) => (Math.log10(Math.max(v, 10 ** from)) - from) / (to - from), ticks };
}

// Error over milliseconds. Points: {n, x, y, front, isDefault, title}. Points without time are in a strip on the left.
function scatter(points, xName, yName, floor) {
  const [width, height, left, top, right, bottom] = [640, 400, 66, 14, 14, 46];
  const free = points.some((p) => p.x <= 0), strip = free ? 46 : 0;
  const x = logAxis(points.map((p) => p.x), 0.01), y = logAxis(points.map((p) => p.y), 1e-6);
  const [x0, x1, y0, y1] = [left + strip, width - right, height - bottom, top];
  const px = (v) => (v > 0 ? x0 + x.at(v) * (x1 - x0) : left + strip / 2);
  const py = (v) => y0 + y.at(v) * (y1 - y0);
  let out = `<svg viewBox="0 0 ${width} ${height}" role="img" aria-label="${clean(yName)} over ${clean(xName)}">`;
  const noise = floor > 0 ? Math.min(Math.max(py(floor), y1), y0) : y0;
  if (noise < y0) out += `<rect class="noise" x="${left}" y="${noise}" width="${x1 - left}" height="${y0 - noise}"/><text x="${x1 - 6}" y="${y0 - 7}" text-anchor="end">within the truth's noise</text>`;
  for (const t of x.ticks) out += `<line class="grid" x1="${px(t)}" x2="${px(t)}" y1="${y0}" y2="${y1}"/><text x="${px(t)}" y="${y0 + 18}" text-anchor="middle">${short(t)}</text>`;
  for (const t of y.ticks) out += `<line class="grid" x1="${left}" x2="${x1}" y1="${py(t)}" y2="${py(t)}"/><text x="${left - 8}" y="${py(t) + 4}" text-anchor="end">${short(t)}</text>`;
  if (free) out += `<line class="grid" x1="${x0}" x2="${x0}" y1="${y0}" y2="${y1}" stroke-dasharray="3 3"/><text x="${left + strip / 2}" y="${y0 + 18}" text-anchor="middle">0</text>`;
  out += `<text class="axis" x="${(left + x1) / 2}" y="${height - 6}" text-anchor="middle">${clean(xName)}</text>`;
  out += `<text class="axis" transform="translate(14 ${(y0 + y1) / 2}) rotate(-90)" text-anchor="middle">${clean(yName)}</text>`;
  const front = points.filter((p) => p.front).sort((a, b) => a.x - b.x || b.y - a.y);
  if (front.length) {
    let path = `M${px(front[0].x)} ${y1} L${px(front[0].x)} ${py(front[0].y)}`;
    for (let i = 1; i < front.length; i++) path += ` L${px(front[i].x)} ${py(front[i - 1].y)} L${px(front[i].x)} ${py(front[i].y)}`;
    out += `<path class="front-line" d="${path} L${x1} ${py(front[front.length - 1].y)}"/>`;
  }
  const placed = [];
  for (const p of [...points].sort((a, b) => b.front - a.front || a.n - b.n)) {
    const [cx, cy] = [px(p.x), py(p.y)];
    let [sx, sy] = [cx, cy];
    for (let turn = 0; placed.some(([a, b]) => Math.hypot(a - sx, b - sy) < 21) && turn < 60; turn++) {
      const angle = turn * 0.9, far = 12 + 2.2 * turn;
      [sx, sy] = [Math.min(Math.max(cx + far * Math.cos(angle), left + 10), x1 - 10), Math.min(Math.max(cy - far * Math.sin(angle), y1 + 4), y0 - 10)];
    }
    placed.push([sx, sy]);
    if (sx !== cx || sy !== cy) out += `<line class="away" x1="${cx}" y1="${cy}" x2="${sx}" y2="${sy}"/><circle cx="${cx}" cy="${cy}" r="2" fill="var(--behind)"/>`;
    out += `<g class="point ${p.front ? "front" : ""} ${p.isDefault ? "default" : ""}"><title>${clean(p.title)}</title><circle cx="${sx}" cy="${sy}" r="10"/><text x="${sx}" y="${sy}">${p.n}</text></g>`;
  }
  return out + "</svg>";
}

// Errors over frames. Lines: {n, front, values: [[frame, error], …]}.
function curves(lines, yName) {
  const [width, height, left, top, right, bottom] = [640, 220, 66, 10, 34, 42];
  const all = lines.flatMap((l) => l.values);
  const x = logAxis(all.map((v) => v[0]), 1), y = logAxis(all.map((v) => v[1]), 1e-6);
  const [x0, x1, y0, y1] = [left, width - right, height - bottom, top];
  const px = (v) => x0 + x.at(v) * (x1 - x0), py = (v) => y0 + y.at(v) * (y1 - y0);
  let out = `<svg viewBox="0 0 ${width} ${height}" role="img" aria-label="${clean(yName)} over frames">`;
  for (const t of [...new Set(all.map((v) => v[0]))]) out += `<line class="grid" x1="${px(t)}" x2="${px(t)}" y1="${y0}" y2="${y1}"/><text x="${px(t)}" y="${y0 + 18}" text-anchor="middle">${t}</text>`;
  for (const t of y.ticks) out += `<line class="grid" x1="${x0}" x2="${x1}" y1="${py(t)}" y2="${py(t)}"/><text x="${left - 8}" y="${py(t) + 4}" text-anchor="end">${short(t)}</text>`;
  out += `<text class="axis" x="${(x0 + x1) / 2}" y="${height - 4}" text-anchor="middle">frames</text>`;
  out += `<text class="axis" transform="translate(14 ${(y0 + y1) / 2}) rotate(-90)" text-anchor="middle">${clean(yName)}</text>`;
  const ends = [];
  for (const line of lines) {
    const path = line.values.map(([f, e], i) => `${i ? "L" : "M"}${px(f)} ${py(e)}`).join(" ");
    out += `<path class="curve ${line.front ? "front" : ""}" d="${path}"/>`;
    for (const [f, e] of line.values) out += `<circle cx="${px(f)}" cy="${py(e)}" r="2.5" fill="var(${line.front ? "--front" : "--behind"})"/>`;
    const last = line.values[line.values.length - 1];
    ends.push({ y: py(last[1]), x: px(last[0]), n: line.n });
  }
  // Labels at the ends of the lines; those that would overlap are merged.
  ends.sort((a, b) => a.y - b.y);
  for (let i = 0; i < ends.length; ) {
    let j = i + 1;
    while (j < ends.length && ends[j].y - ends[i].y < 13) j++;
    const group = ends.slice(i, j);
    out += `<text x="${group[0].x + 8}" y="${group.reduce((s, g) => s + g.y, 0) / group.length + 4}">${group.map((g) => g.n).sort((a, b) => a - b).join(", ")}</text>`;
    i = j;
  }
  return out + "</svg>";
}
