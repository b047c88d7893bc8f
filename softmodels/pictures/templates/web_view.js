// The device in 3-D, over all steps: drag turns, wheel zooms, shift and drag moves. WebGL 2, no library, no network.
"use strict";
(async function () {
  const meta = JSON.parse(document.getElementById("viewer-meta").textContent);
  const box = document.getElementById("viewer");
  const find = (id) => document.getElementById("viewer-" + id);
  const canvas = find("canvas");
  const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  const sorry = (text) => { find("note").textContent = text; box.classList.add("off"); };
  if (!gl) return sorry("This browser shows no WebGL 2, so the 3-D view is left out; the pictures below need none.");
  if (!window.DecompressionStream) return sorry("This browser is too old for the 3-D view (before 2023).");

  // -- data: 16-bit numbers, differences from step to step, low bytes before high bytes, gzip, base64 ---------------
  const packed = Uint8Array.from(atob(find("data").textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  let at = 0;
  function column(count) {
    const found = new Uint16Array(count);
    for (let i = 0; i < count; i++) found[i] = bytes[at + i] | (bytes[at + count + i] << 8);
    at += 2 * count;
    return found;
  }
  function numbers(count) {
    const low = column(count), high = column(count);
    return Uint32Array.from(low, (v, i) => v | (high[i] << 16));
  }
  const n = meta.vertices, triangles = numbers(3 * meta.triangles), edges = numbers(2 * meta.edges);
  const nodes = 1 + Math.max(...meta.split.flat()), cells = numbers(nodes * meta.cells);
  const places = [], fields = [];
  for (let s = 0; s < meta.steps.length; s++) {
    const place = column(3 * n), values = meta.fields.map(() => column(n));
    if (s) {
      for (let i = 0; i < 3 * n; i++) place[i] += places[s - 1][i];
      values.forEach((value, f) => { for (let i = 0; i < n; i++) value[i] += fields[s - 1][f][i]; });
    }
    places.push(place);
    fields.push(values);
  }
  const unpacked = (place) => Float32Array.from(place, (v, i) => meta.low[i % 3] + (meta.span * v) / 65535);
  const rest = unpacked(places[0]);
  const onPlane = meta.planes.map((p) => {
    const here = [];
    for (let i = 0; i < n; i++) {
      const d = p[0] * rest[3 * i] + p[1] * rest[3 * i + 1] + p[2] * rest[3 * i + 2];
      if (Math.abs(d) < (3 * meta.span) / 65535) here.push(i);
    }
    return here;
  });
  // What lies in a symmetry plane does so to the last digit, or the images of the slice leave cracks between them.
  function metres(place) {
    const found = unpacked(place);
    meta.planes.forEach((p, k) => {
      for (const i of onPlane[k]) {
        const d = p[0] * found[3 * i] + p[1] * found[3 * i + 1] + p[2] * found[3 * i + 2];
        for (let j = 0; j < 3; j++) found[3 * i + j] -= d * p[j];
      }
    });
    return found;
  }
  rest.set(metres(places[0]));

  // -- the cut: where a plane of the undeformed device meets its silicone ------------------------------------------
  // Each corner of the cut lies between two nodes of one image of the slice: their numbers, the share, the image.
  let section = null;
  function cutAt(clip) {
    const found = { one: [], other: [], share: [], image: [] }, d = new Float32Array(n);
    meta.images.forEach((m, k) => {
      const p = [0, 1, 2].map((j) => clip[0] * m[j] + clip[1] * m[3 + j] + clip[2] * m[6 + j]);
      for (let i = 0; i < n; i++) {
        d[i] = p[0] * rest[3 * i] + p[1] * rest[3 * i + 1] + p[2] * rest[3 * i + 2] - clip[3] + 2e-5 * meta.span;
      }
      const corner = (a, b) => {
        found.one.push(a); found.other.push(b); found.share.push(d[a] / (d[a] - d[b])); found.image.push(k);
      };
      for (let c = 0; c < cells.length; c += nodes) {
        for (const part of meta.split) {
          const before = [], behind = [];
          for (const j of part) (d[cells[c + j]] > 0 ? before : behind).push(cells[c + j]);
          if (!before.length || !behind.length) continue;
          if (before.length === 2) {
            const [a, b] = before, [e, f] = behind;
            for (const [x, y] of [[a, e], [a, f], [b, e], [b, e], [a, f], [b, f]]) corner(x, y);
          } else {
            const [alone, three] = before.length === 1 ? [before[0], behind] : [behind[0], before];
            for (const x of three) corner(alone, x);
          }
        }
      }
    });
    return found;
  }
  function cutPlaces(place, value) {
    const count = section.one.length, at = new Float32Array(3 * count), of = new Uint16Array(count);
    for (let i = 0; i < count; i++) {
      const a = section.one[i], b = section.other[i], t = section.share[i], m = meta.images[section.image[i]];
      const q = [0, 1, 2].map((j) => place[3 * a + j] + t * (place[3 * b + j] - place[3 * a + j]));
      for (let j = 0; j < 3; j++) at[3 * i + j] = m[3 * j] * q[0] + m[3 * j + 1] * q[1] + m[3 * j + 2] * q[2];
      of[i] = Math.round(value[a] + t * (value[b] - value[a]));
    }
    return [at, of];
  }

  // -- drawing ------------------------------------------------------------------------------------------------------
  // No light: a pixel's colour is that of the bar.
  const vertexText = `#version 300 es
    in vec3 rest, place; in float value;
    uniform mat3 image; uniform mat4 view; uniform float deformed;
    out vec3 material; out float v;
    void main() {
      material = image * rest; v = value;
      gl_Position = view * vec4(image * mix(rest, place, deformed), 1.0);
    }`;
  const fragmentText = `#version 300 es
    precision highp float;
    in vec3 material; in float v;
    uniform vec4 clip; uniform float alpha; uniform vec3 plain; uniform bool coloured;
    uniform sampler2D colours;
    out vec4 colour;
    void main() {
      if (dot(material, clip.xyz) > clip.w) discard;
      vec3 paint = coloured ? texture(colours, vec2((0.5 + 255.0 * v) / 256.0, 0.5)).rgb : plain;
      colour = vec4(paint * alpha, alpha);
    }`;
  function shader(kind, text) {
    const made = gl.createShader(kind);
    gl.shaderSource(made, text); gl.compileShader(made);
    if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(made));
    return made;
  }
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, vertexText));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, fragmentText));
  gl.linkProgram(program); gl.useProgram(program);
  const uniform = (name) => gl.getUniformLocation(program, name);
  function mesh(indices) {  // a set of buffers: of the surface, or of the cut
    const made = { array: gl.createVertexArray(), buffers: {} };
    gl.bindVertexArray(made.array);
    for (const [name, size] of [["rest", 3], ["place", 3], ["value", 1]]) {
      made.buffers[name] = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, made.buffers[name]);
      const where = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(where);
      if (size === 1) gl.vertexAttribPointer(where, 1, gl.UNSIGNED_SHORT, true, 0, 0);
      else gl.vertexAttribPointer(where, 3, gl.FLOAT, false, 0, 0);
    }
    if (indices) {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    }
    return made;
  }
  const fill = (of, name, data) => { gl.bindBuffer(gl.ARRAY_BUFFER, of.buffers[name]); gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW); };
  const skin = mesh(Uint32Array.from([...triangles, ...edges])), face = mesh(null);
  fill(skin, "rest", rest);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, meta.colours.length, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE,
    new Uint8Array(meta.colours.flatMap((c) => [...c, 255])));
  for (const kind of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, kind, gl.LINEAR);
  for (const kind of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, kind, gl.CLAMP_TO_EDGE);

  const add = (a, b, s = 1) => a.map((v, i) => v + s * b[i]);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => a.map((v) => v / Math.sqrt(dot(a, a)));
  const turned = (a, axis, angle) => {  // Rodrigues
    const c = Math.cos(angle), s = Math.sin(angle);
    return add(add(a.map((v) => c * v), cross(axis, a), s), axis, dot(axis, a) * (1 - c));
  };
  const start = { towards: unit(meta.direction), up: meta.up, focus: meta.focus, scale: meta.scale };
  let eye = { ...start }, shown = null;
  // Half the picture's height: on a narrow screen the device's width decides it.
  const half = () => eye.scale * Math.max(1, (meta.aspect * canvas.clientHeight) / canvas.clientWidth);
  const state = () => ({ step: +find("step").value, field: +find("field").value, through: find("through").checked,
    axis: +find("axis").value, cut: +find("cut").value });

  function draw() {
    const now = state();
    const place = metres(places[now.step]), value = fields[now.step][now.field];
    if (!shown || shown.step !== now.step) fill(skin, "place", place);
    if (!shown || shown.step !== now.step || shown.field !== now.field) fill(skin, "value", value);
    const field = meta.fields[now.field];
    find("label").textContent = meta.subject + ": " + meta.steps[now.step].label;
    find("low").textContent = field.low; find("top").textContent = "≥ " + +field.top.toPrecision(4) + " " + field.unit;
    find("middle").textContent = +(field.low + (field.top - field.low) * 0.5 ** (1 / field.power)).toPrecision(4);
    find("what").textContent = field.label;
    find("cut").disabled = now.axis < 0;

    const ratio = Math.min(window.devicePixelRatio || 1, 2), wide = canvas.clientWidth, tall = canvas.clientHeight;
    if (canvas.width !== Math.round(wide * ratio)) { canvas.width = Math.round(wide * ratio); canvas.height = Math.round(tall * ratio); }
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(1, 1, 1, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT); gl.enable(gl.DEPTH_TEST);
    const right = unit(cross(eye.up, eye.towards)), above = cross(eye.towards, right);
    const y = 1 / half(), x = (y * tall) / wide, z = 1 / (6 * meta.scale * Math.max(1, meta.aspect, wide / tall));
    const row = (axis, s) => [...axis.map((v) => s * v), -s * dot(axis, eye.focus)];
    const [a, b, c] = [row(right, x), row(above, y), row(eye.towards, -z)];
    gl.uniformMatrix4fv(uniform("view"), false, [0, 1, 2, 3].flatMap((i) => [a[i], b[i], c[i], i === 3 ? 1 : 0]));
    const clip = [0, 0, 0, 1e9];
    if (now.axis >= 0) {
      const side = eye.towards[now.axis] >= 0 ? 1 : -1;  // what is before the cut is taken away
      clip[now.axis] = side;
      clip[3] = side * (meta.box[0][now.axis] + now.cut * (meta.box[1][now.axis] - meta.box[0][now.axis]));
    }
    gl.uniform4fv(uniform("clip"), clip);
    if (now.axis < 0) section = null;
    else {
      if (!section || section.clip.some((v, i) => v !== clip[i])) section = { ...cutAt(clip), clip };
      const [at, of] = cutPlaces(place, value);
      fill(face, "rest", at); fill(face, "place", at); fill(face, "value", of);
    }
    shown = now;
    const pass = (kind, first, count, alpha, coloured, deformed = 1, plain = [0.62, 0.72, 0.82]) => {
      gl.bindVertexArray(skin.array);
      gl.uniform1f(uniform("alpha"), alpha); gl.uniform1i(uniform("coloured"), coloured ? 1 : 0);
      gl.uniform1f(uniform("deformed"), deformed); gl.uniform3fv(uniform("plain"), plain);
      for (const image of meta.images) {
        gl.uniformMatrix3fv(uniform("image"), true, image);
        const [p, q, r] = [image.slice(0, 3), image.slice(3, 6), image.slice(6, 9)];
        gl.frontFace(dot(p, cross(q, r)) < 0 ? gl.CW : gl.CCW);
        gl.drawElements(kind, count, gl.UNSIGNED_INT, 4 * first);
      }
    };
    const every = 3 * meta.triangles;
    const drawLines = () => {
      pass(gl.LINES, every, 2 * meta.edges, 1, false, 1, now.through ? [0.2, 0.3, 0.4] : [0.85, 0.87, 0.9]);
      if (now.step) pass(gl.LINES, every, 2 * meta.edges, 1, false, 0, [0.6, 0.6, 0.6]);
    };
    const cutFace = () => {  // all of it is in the plane: nothing of it is taken away
      if (!section || !section.one.length) return;
      gl.bindVertexArray(face.array);
      gl.uniform4fv(uniform("clip"), [0, 0, 0, 1e9]);
      gl.uniform1f(uniform("alpha"), 1); gl.uniform1i(uniform("coloured"), 1); gl.uniform1f(uniform("deformed"), 1);
      gl.uniformMatrix3fv(uniform("image"), true, [1, 0, 0, 0, 1, 0, 0, 0, 1]);
      gl.drawArrays(gl.TRIANGLES, 0, section.one.length);
      gl.uniform4fv(uniform("clip"), clip);
    };
    // Where a wall turns away from the viewer its two sides lie at one depth: the side seen from within the silicone wins,
    // or a dotted line is seen through the cut.
    const solid = () => {
      gl.enable(gl.CULL_FACE); gl.cullFace(gl.FRONT);
      pass(gl.TRIANGLES, 0, every, 1, true);
      gl.cullFace(gl.BACK); gl.enable(gl.POLYGON_OFFSET_FILL); gl.polygonOffset(2, 4);
      pass(gl.TRIANGLES, 0, every, 1, true);
      gl.disable(gl.POLYGON_OFFSET_FILL); gl.disable(gl.CULL_FACE);
      cutFace();
      drawLines();
    };
    gl.disable(gl.BLEND); gl.depthMask(true);
    if (now.through) {
      // Of the outside only what is behind the walls: before them it would change their colours.
      gl.enable(gl.BLEND); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA); gl.depthMask(false);
      gl.enable(gl.CULL_FACE); gl.cullFace(gl.FRONT);
      pass(gl.TRIANGLES, 0, 3 * meta.outside, 0.25, false);
      gl.depthMask(true); gl.disable(gl.CULL_FACE); gl.disable(gl.BLEND);
      pass(gl.TRIANGLES, 3 * meta.outside, every - 3 * meta.outside, 1, true);
      cutFace();
      drawLines();
    } else solid();
    rulers(right, above, tall);
  }
  // Axes and a bar of a round length, both as the view lies now.
  function rulers(right, above, tall) {
    const pixel = (2 * half()) / tall, series = [3, 2, 1, 0, -1, -2, -3, -4].flatMap((e) => [5, 2, 1].map((k) => k * 10 ** e));
    const length = series.find((mm) => mm <= 1e3 * pixel * 140);
    find("bar").style.width = length / 1e3 / pixel + "px"; find("bar").textContent = length + " mm";
    find("axes").innerHTML = ["x", "y", "z"].map((name, k) => {
      const x = right[k], y = -above[k], size = Math.hypot(x, y);
      if (size < 0.15) return "";
      const text = `<text x="${40 + 28 * x + (10 * x) / size}" y="${44 + 28 * y + (10 * y) / size}">${name}</text>`;
      return `<line x1="40" y1="40" x2="${40 + 28 * x}" y2="${40 + 28 * y}"/>` + text;
    }).join("");
  }
  let waiting = false;
  const redraw = () => { if (!waiting) { waiting = true; requestAnimationFrame(() => { waiting = false; draw(); }); } };

  // -- hands --------------------------------------------------------------------------------------------------------
  const fingers = new Map();
  canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); fingers.set(e.pointerId, [e.clientX, e.clientY]); });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => fingers.delete(e.pointerId));
  canvas.addEventListener("pointermove", (e) => {
    const before = fingers.get(e.pointerId);
    if (!before) return;
    const now = [e.clientX, e.clientY], dx = now[0] - before[0], dy = now[1] - before[1];
    const right = unit(cross(eye.up, eye.towards));
    if (fingers.size === 2) {  // pinch
      const other = [...fingers].find(([id]) => id !== e.pointerId)[1];
      const gap = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      eye.scale *= gap(before) / gap(now);
    } else if (e.shiftKey || e.buttons === 2 || e.buttons === 4) {
      const s = (2 * half()) / canvas.clientHeight;
      eye.focus = add(add(eye.focus, right, -dx * s), cross(eye.towards, right), dy * s);
    } else {
      let towards = turned(eye.towards, eye.up, -dx * 0.008);
      const tilted = turned(towards, unit(cross(eye.up, towards)), -dy * 0.008);
      if (Math.abs(dot(tilted, eye.up)) < 0.995) towards = tilted;
      eye.towards = unit(towards);
    }
    fingers.set(e.pointerId, now);
    redraw();
  });
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); eye.scale *= Math.exp(e.deltaY * 0.001); redraw(); }, { passive: false });
  for (const id of ["step", "field", "through", "axis", "cut"]) find(id).addEventListener("input", redraw);
  find("reset").addEventListener("click", () => { eye = { ...start }; redraw(); });
  let timer = 0;
  find("play").addEventListener("click", () => {
    const slider = find("step");
    if (timer) { clearInterval(timer); timer = 0; find("play").textContent = "▶ play"; return; }
    find("play").textContent = "❚❚ stop";
    timer = setInterval(() => { slider.value = (+slider.value + 1) % meta.steps.length; redraw(); }, Math.max(80, 3500 / meta.steps.length));
  });
  window.addEventListener("resize", redraw);
  draw();
  box.dataset.drawn = "yes";
})().catch((error) => { document.getElementById("viewer-note").textContent = "The 3-D view failed: " + error.message; });
