"use strict";
// sections that are folded are printed unfolded
const folded = [];
addEventListener("beforeprint", () => {
  for (const details of document.querySelectorAll("#claims details:not([open])")) {
    details.open = true;
    folded.push(details);
  }
});
addEventListener("afterprint", () => {
  while (folded.length) folded.pop().open = false;
});
// a link to something inside a folded section unfolds it
const unfold = () => {
  const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const details = target && (target.closest("details") || target.querySelector(":scope > details"));
  if (details) details.open = true;
};
addEventListener("hashchange", unfold);
unfold();

const data = document.getElementById("played");
if (data) {
  const played = JSON.parse(data.textContent);
  const slider = document.getElementById("play-slider");
  const button = document.getElementById("play-button");
  const now = document.getElementById("play-now");
  const rows = document.querySelectorAll("#play-values tr");
  const drawn = Object.entries(played.figures).map(([id, figure]) =>
    Plotly.newPlot(id, figure.data, figure.layout, { displayModeBar: false, responsive: true, scrollZoom: false })
  );

  const show = (number) => {
    const frame = played.frames[number];
    Plotly.update("play-depth", { x: [frame.u], y: [frame.v] }, { "images[0].source": frame.image }, [0]);
    for (const id of Object.keys(played.figures)) {
      const shapes = document.getElementById(id).layout.shapes || [];
      const cursor = shapes.findIndex((shape) => shape.yref === "paper");
      if (cursor >= 0) Plotly.relayout(id, { [`shapes[${cursor}].x0`]: frame.t, [`shapes[${cursor}].x1`]: frame.t });
    }
    for (const row of rows) {
      const of = frame.models[row.dataset.model];
      const [first, second] = of.ellipses;
      const [q1, q2, q3] = frame.measured;
      Plotly.restyle(
        `play-spread-${row.dataset.model}`,
        { x: [first[0], [q1], second[0], [q2]], y: [first[1], [q2], second[1], [q3]] },
        [0, 1, 3, 4]
      );
      const texts = of.error.map((error, joint) => `${error.toFixed(1)} ± ${of.bound[joint].toFixed(1)}`);
      [...texts, String(of.ess)].forEach((text, place) => (row.cells[place + 1].textContent = text));
    }
    const text = `${Number(number) + 1} of ${played.frames.length}, ${frame.t.toFixed(2)} s`;
    now.textContent = text;
    slider.setAttribute("aria-valuetext", text);
  };

  let timer = null;
  const stop = () => {
    clearInterval(timer);
    timer = null;
    button.textContent = "Play";
    button.setAttribute("aria-pressed", "false");
  };
  button.addEventListener("click", () => {
    if (timer) return stop();
    if (slider.value === slider.max) slider.value = "0";
    button.textContent = "Pause";
    button.setAttribute("aria-pressed", "true");
    timer = setInterval(() => {
      slider.stepUp();
      show(slider.value);
      if (slider.value === slider.max) stop();
    }, 200);
  });
  slider.addEventListener("input", () => {
    stop();
    show(slider.value);
  });
  Promise.all(drawn).then(() => show(slider.value));
}
