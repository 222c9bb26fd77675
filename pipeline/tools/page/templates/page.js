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

// the arm in space: a function that draws a frame of it, in a parallel projection that is turned
const turnable = (scene, current) => {
  const { centre, radius, path } = JSON.parse(scene.dataset.scene);
  const turn = document.getElementById("play-turn");
  const tilt = document.getElementById("play-tilt");
  const nodes = document.getElementById("play-nodes");
  const points = (places) => places.map((place) => place.join(",")).join(" ");

  const draw = (frame) => {
    const [yaw, pitch] = [turn, tilt].map((input) => (input.value * Math.PI) / 180);
    const right = [-Math.sin(yaw), Math.cos(yaw), 0];
    const down = [Math.sin(pitch) * Math.cos(yaw), Math.sin(pitch) * Math.sin(yaw), -Math.cos(pitch)];
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const scale = 0.9 / radius;
    const project = (place) => {
      const from = place.map((value, axis) => value - centre[axis]);
      return [right, down].map((side) => (scale * dot(side, from)).toFixed(4));
    };
    document.getElementById("play-path").setAttribute("points", points(path.map(project)));
    const joints = frame.nodes.map(project);
    document.getElementById("play-links").setAttribute("points", points(joints));
    nodes.replaceChildren(
      ...joints.map(([x, y]) => {
        const circle = document.createElementNS("http://www.w3.org/2000/svg", "circle");
        for (const [name, value] of Object.entries({ cx: x, cy: y, r: 0.018 })) circle.setAttribute(name, value);
        return circle;
      }),
    );
    ["x", "y", "z"].forEach((name, axis) => {
      const [line, text] = scene.querySelectorAll(`.axis-${name}`);
      const [from, to] = [0, 0.25 * radius].map((value) => project([0, 1, 2].map((k) => (k === axis ? value : 0))));
      const ends = { x1: from[0], y1: from[1], x2: to[0], y2: to[1] };
      for (const [key, value] of Object.entries(ends)) line.setAttribute(key, value);
      text.setAttribute("x", to[0]);
      text.setAttribute("y", to[1]);
    });
    // the outline of an ellipsoid in a parallel projection is the ellipse of the projected covariance
    for (const tip of scene.querySelectorAll(".tip")) {
      const { place, covariance } = frame.tips[tip.dataset.model];
      const [xx, xy, xz, yy, yz, zz] = covariance;
      const times = (side) => [
        dot([xx, xy, xz], side), dot([xy, yy, yz], side), dot([xz, yz, zz], side),
      ];
      const [a, b, c] = [dot(right, times(right)), dot(down, times(right)), dot(down, times(down))];
      const first = Math.sqrt(Math.max(a, 0));
      const across = first > 0 ? b / first : 0;
      const second = Math.sqrt(Math.max(c - across * across, 0));
      const root = [first, across, 0, second].map((value) => (scale * value).toFixed(5));
      tip.firstElementChild.setAttribute("transform", `matrix(${[...root, ...project(place)].join(" ")})`);
    }
  };

  const redraw = () => draw(current());
  for (const input of [turn, tilt]) input.addEventListener("input", redraw);
  scene.addEventListener("pointerdown", (event) => scene.setPointerCapture(event.pointerId));
  scene.addEventListener("pointermove", (event) => {
    if (!scene.hasPointerCapture(event.pointerId)) return;
    turn.value = ((Number(turn.value) - event.movementX / 2 + 540) % 360) - 180;
    tilt.value = Number(tilt.value) + event.movementY / 2;
    redraw();
  });
  return draw;
};

// the outlines of the player's plots and its frames stand in player.js
if (window.played) {
  const { frames, paths } = window.played;
  for (const [plot, outlines] of Object.entries(paths)) {
    document.querySelectorAll(`#${CSS.escape(plot)} .shape`).forEach((shape, place) => {
      shape.setAttribute("d", outlines[place]);
    });
  }
  const slider = document.getElementById("play-slider");
  const button = document.getElementById("play-button");
  const now = document.getElementById("play-now");
  const image = document.getElementById("play-image");
  const links = document.getElementById("play-links");
  const scene = document.getElementById("play-scene");
  const draw = scene ? turnable(scene, () => frames[slider.value]) : null;
  const cursors = document.querySelectorAll(".cursor");
  const rows = document.querySelectorAll("#play-values tr");

  const show = (number) => {
    const frame = frames[number];
    if (draw) {
      draw(frame);
    } else {
      image.setAttribute("href", frame.image);
      links.setAttribute("points", frame.links);
    }
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
