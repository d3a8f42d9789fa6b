// Builds the page from the embedded numbers.
const { report, metrics, truths, images } = JSON.parse(document.getElementById("data").textContent);
const run = report.run;
const choice = { metric: "auto", image: "auto", price: "auto" };
const metricName = Object.fromEntries(metrics);

const errorOf = (comparison, metric) => (metric === "dssim" ? 1 - comparison.ssim : comparison[metric]);
// The last error of an image.
const comparison = (row, image) => (image === "moving" ? row.moving && row.moving.picture : row.errors[row.errors.length - 1][image]);
const imageName = { slot: "its own image", picture: "the picture", moving: "the picture while the camera moves" };
const picture = (name, alt) => (images[name] ? `<img alt="${clean(alt)}" src="data:image/png;base64,${images[name]}">` : "");

function head() {
  const facts = {
    Scene: run.scene, Size: run.size.join(" × "), Device: run.device.name, Driver: run.device.driver, "Rays by": run.rays,
    Magpie: `${run.magpie}, commit ${run.commit}`, Date: run.date,
    Truths: `${run.samples} samples per pixel`, Frames: `errors after ${run.frames.join(", ")}`, Times: run.minutes ? `a race of at most ${run.minutes} minutes` : `medians of ${run.rounds} rounds of ${run.timed} frames`,
  };
  const left = run.plan.left_out.map(([slot, why]) => `${slot} (${why})`).join("; ");
  return `<h1>What accuracy costs</h1>
    <p class="soft">Every implementation of every stage, and every step of its settings: how far it is from a path-traced truth, and how many milliseconds of the GPU it takes. All else is as by default.</p>
    <dl class="facts">${Object.entries(facts).map(([k, v]) => `<div><dt>${k}</dt><dd>${clean(v)}</dd></div>`).join("")}</dl>
    ${left ? `<p class="soft">Not measured: ${clean(left)}.</p>` : ""}
    ${report.unreached.length ? `<p class="soft">No time was left for: ${clean(report.unreached.map(([slot, label]) => `${slot} (${label})`).join("; "))}.</p>` : ""}
    <div class="controls">
      <label>Error <select id="metric"><option value="auto">that of the fronts</option>${metrics.map(([k, n]) => `<option value="${k}">${n}</option>`).join("")}</select></label>
      <label>of <select id="image"><option value="auto">that of the fronts</option><option value="picture">the final picture</option><option value="slot">the stage's own image</option><option value="moving">the picture in motion</option></select></label>
      <label>over <select id="price"><option value="auto">the stage's time</option><option value="frame">the frame's time</option></select></label>
    </div><div id="effects"></div>
    <p class="soft">Blue: on the Pareto front, nothing is both more accurate and cheaper. Times closer than 6 %, than their ratio spreads from round to round, or than 1 % of the frame, count as the same; errors closer than 1 % too. Orange ring: the default. Axes are logarithmic.</p>`;
}

function effect(e) {
  const wanted = choice.image === "auto" ? e.judged_by : choice.image;
  const image = e.rows.length && e.rows.every((row) => comparison(row, wanted)) ? wanted : "picture";
  const metric = choice.metric === "auto" ? e.metric : choice.metric;
  const byFrame = choice.price === "frame" || e.price === "frame";
  const area = e.slot === "post" ? "_area" : "";
  const only = image === "slot" ? truths[e.slot] : `all${image === "moving" ? "_moving" : ""}${area}`;
  const truth = report.truths.find((t) => t.only === only);
  const floor = truth ? errorOf(truth.floor, metric) : 0;
  const name = `${metricName[metric]} of ${imageName[image]}`;
  const rows = e.rows.map((row, at) => {
    const standing = (row.standing[image] || {})[metric];
    const noisy = ((row.within_noise || {})[image] || []).includes(metric);
    return { row, n: at + 1, front: standing === "front", by: standing && standing["dominated-by"], noisy, error: errorOf(comparison(row, image), metric), ms: byFrame ? row.frame_ms : row.ms };
  });
  const points = rows.map((r) => ({ n: r.n, x: r.ms, y: r.error, front: r.front, isDefault: r.row.variant.is_default, title: `${r.row.variant.label}\n${metricName[metric]} ${short(r.error)}, ${short(r.ms)} ms` }));
  const why = (r) => {
    const numbers = `${short(r.error)} at ${short(r.ms)} ms${r.row.ms_interval > 0.05 * r.row.ms ? ` ± ${short(r.row.ms_interval)}` : ""}${r.row.sure < 0.95 && image === e.judged_by && metric === e.metric ? `, ${short(100 * r.row.sure)} % sure` : ""}${r.noisy ? ", within the truth's noise" : ""}`;
    if (r.front || r.by === undefined) return numbers;
    const better = rows[r.by], ratio = r.error / better.error;
    const how = ratio > 1.01 ? `${short(ratio)} times the error, and not noticeably cheaper` : "as accurate, and not noticeably cheaper";
    return `${numbers}. Dominated by ${better.n} (${clean(better.row.variant.label)}): ${how}`;
  };
  const list = rows.map((r) => `<li class="${r.front ? "front" : ""} ${r.row.variant.is_default ? "default" : ""}"><span class="badge">${r.n}</span><span class="name">${clean(r.row.variant.label)}</span><span class="why">${why(r)}</span></li>`).join("");
  const still = image === "moving" ? "picture" : image;
  // The frame before the last only serves to measure the change by one frame.
  const told = (errors) => errors.filter((x, i) => i + 1 === errors.length || errors[i + 1].frame > x.frame + 1);
  const lines = rows.map((r) => ({ n: r.n, front: r.front, values: told(r.row.errors).map((x) => [x.frame, errorOf(x[still], metric)]) }));
  return `<section id="${clean(e.slot)}"><div class="head"><h2>${clean(e.slot)}</h2><span class="soft">${name} over milliseconds of ${byFrame ? "the frame" : "its passes"}</span></div>
    <div class="two"><div>${scatter(points, `milliseconds of ${byFrame ? "the frame" : "the stage"}`, metricName[metric], floor)}</div><ol class="rows">${list}</ol></div>
    ${lines.some((l) => l.values.length > 1) ? `<h3>Error over frames</h3><div class="two"><div>${curves(lines, metricName[metric])}</div><p class="soft">At a fixed camera. A stage that gathers over frames falls; one that does not stays level.</p></div>` : ""}
    ${shots(e, rows, still, image === "moving" ? `all${area}` : only)}${table(e, rows, image)}</section>`;
}

function shots(e, rows, image, only) {
  const of = (setup, what) => picture(`${setup}.${image === "slot" ? e.slot : "picture"}.${what}`, what);
  const seen = rows.map((r) => `<figure><div class="pair">${of(r.row.variant.setup, "png")}${of(r.row.variant.setup, "flip.png")}</div><figcaption><b>${r.n}</b> ${clean(r.row.variant.label)}</figcaption></figure>`).join("");
  const truth = picture(`truth.${only}.png`, "truth");
  if (!truth && !seen.includes("<img")) return "";
  return `<h3>${image === "slot" ? "Its own image" : "The picture"} after ${run.frames[run.frames.length - 1]} frames, and where FLIP sees a difference from the truth (black: none)</h3>
    <div class="shots"><figure><div class="pair">${truth}</div><figcaption><b>truth</b>, ${run.samples} samples per pixel</figcaption></figure>${seen}</div>`;
}

function table(e, rows, image) {
  const columns = [
    ["ms", (r) => short(r.row.stage.ms)], ["least", (r) => short(r.row.stage.min_ms)], ["trace", (r) => short(r.row.stage.trace_ms)], ["denoise", (r) => short(r.row.stage.denoise_ms)],
    ["frame ms", (r) => short(r.row.frame_ms)], ["rays", (r) => (r.row.stage.rays_any + r.row.stage.rays_closest).toLocaleString("en-GB")],
    ["transient", (r) => bytes(r.row.transient_bytes)], ["history", (r) => bytes(r.row.history_bytes)],
    ...metrics.map(([key, label]) => [label, (r) => short(errorOf(comparison(r.row, image), key))]),
    ["PSNR dB", (r) => short(comparison(r.row, image).psnr)],
    ["picture FLIP", (r) => short(comparison(r.row, "picture").flip_ldr)],
    ["in motion", (r) => short((comparison(r.row, "moving") || {}).flip_ldr)],
    ["rounds", (r) => r.row.rounds.length], ["± ms", (r) => short(r.row.ms_interval)], ["± error", (r) => short(r.row.error_interval)], ["sure", (r) => `${short(100 * r.row.sure)} %`],
  ];
  const body = rows.map((r) => `<tr><td>${r.n} ${clean(r.row.variant.label)}</td>${columns.map(([, of]) => `<td>${of(r)}</td>`).join("")}</tr>`).join("");
  return `<details><summary>All numbers</summary><div class="wide"><table><thead><tr><th>${clean(e.slot)}</th>${columns.map(([c]) => `<th>${c}</th>`).join("")}</tr></thead><tbody>${body}</tbody></table></div></details>`;
}

const draw = () => {
  // Stages with a ground truth of their own come first.
  const own = report.effects.filter((e) => e.judged_by === "slot"), others = report.effects.filter((e) => e.judged_by !== "slot");
  document.getElementById("effects").innerHTML = [...own, ...others].map(effect).join("");
};
document.getElementById("page").innerHTML = head();
for (const id of Object.keys(choice)) document.getElementById(id).onchange = (event) => { choice[id] = event.target.value; draw(); };
draw();
