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

// shadows at the edges behind which more of a wide table lies
const shade = (frame) => {
  const hidden = frame.scrollWidth - frame.clientWidth;
  frame.classList.toggle("more-left", frame.scrollLeft > 1);
  frame.classList.toggle("more-right", frame.scrollLeft < hidden - 1);
};
const sizes = new ResizeObserver((entries) => entries.forEach((entry) => shade(entry.target)));
for (const frame of document.querySelectorAll(".scrolled")) {
  frame.addEventListener("scroll", () => shade(frame), { passive: true });
  sizes.observe(frame);
}

const data = document.getElementById("played");
if (data) {
  const frames = JSON.parse(data.textContent);
  const slider = document.getElementById("play-slider");
  const button = document.getElementById("play-button");
  const now = document.getElementById("play-now");
  const image = document.getElementById("play-image");
  const links = document.getElementById("play-links");
  const cursors = document.querySelectorAll(".cursor");
  const rows = document.querySelectorAll("#play-values tr");

  const show = (number) => {
    const frame = frames[number];
    image.setAttribute("href", frame.image);
    links.setAttribute("points", frame.links);
    for (const cursor of cursors) {
      cursor.setAttribute("x1", `${frame.cursor}%`);
      cursor.setAttribute("x2", `${frame.cursor}%`);
    }
    for (const row of rows) {
      const { texts, ellipses } = frame.models[row.dataset.model];
      const spread = document.getElementById(`play-spread-${row.dataset.model}`);
      spread.querySelectorAll(".ellipse").forEach((ellipse, pair) => {
        ellipse.setAttribute("transform", ellipses[pair]);
      });
      spread.querySelectorAll(".measured").forEach((dot, pair) => {
        dot.setAttribute("cx", frame.dots[pair][0]);
        dot.setAttribute("cy", frame.dots[pair][1]);
      });
      texts.forEach((text, place) => (row.cells[place + 1].textContent = text));
    }
    const text = `${Number(number) + 1} of ${frames.length}, ${frame.t} s`;
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
  show(slider.value);
}
