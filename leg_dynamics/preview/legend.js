"use strict";
/* The legend of forces and efforts, from the userData of /leg; the values follow the viewer's clock. */
function show_legend(viewer) {
  const legend = viewer.scene_tree.find(["leg"]).object.userData.legend;
  if (legend === undefined || document.getElementById("legend") !== null) { return; }

  const element = (parent, tag, name, text) => {
    const made = document.createElement(tag);
    if (name) { made.className = name; }
    if (text !== undefined) { made.textContent = text; }
    parent.append(made);
    return made;
  };
  const signed = (value, decimals) => {
    const digits = Math.abs(value).toFixed(decimals);
    return (Number(digits) === 0 ? "" : value < 0 ? "\u2212" : "+") + digits;
  };
  const short = (value) => String(Number(value.toPrecision(4))).replace("-", "\u2212");

  element(document.head, "style").textContent = `
    #legend { position: absolute; left: 20px; top: 84px; width: 290px; max-width: calc(100vw - 72px); padding: 10px 14px 12px;
      box-sizing: border-box; border-radius: 8px; background: #ffffffc9; color: #1f2933; pointer-events: none;
      font: 13px/1.35 system-ui, sans-serif; font-variant-numeric: tabular-nums; }
    #legend h2 { font-size: 13px; font-weight: 600; margin: 0 0 6px; }
    #legend section + section { margin-top: 12px; }
    #legend .row { display: grid; grid-template-columns: minmax(30px, max-content) 1fr 68px; gap: 8px; align-items: center; height: 22px; }
    #legend .row output { text-align: right; }
    #legend .bar { position: relative; height: 10px; border-radius: 2px; box-shadow: 0 0 0 1px #7b8794; }
    #legend .bar i { position: absolute; top: -4px; bottom: -4px; width: 3px; margin-left: -1.5px; border-radius: 1.5px; background: #1f2933; }
    #legend .bar b { position: absolute; top: 0; bottom: 0; width: 0; border-left: 1px dashed #1f2933; }
    #legend .ticks { position: relative; height: 16px; font-size: 12px; color: #3e4c59; }
    #legend .ticks span { position: absolute; transform: translateX(-50%); white-space: nowrap; }
    #legend .note { color: #3e4c59; font-size: 12px; margin: 2px 0 0; }
    #legend .over output { color: #b3001b; font-weight: 700; }
    #legend .force { display: flex; align-items: center; gap: 8px; }
    #legend .force output { margin-left: auto; }
    @media (max-width: 700px), (max-height: 560px) { #legend { left: 12px; top: auto !important; bottom: 58px; padding: 6px 10px 8px; width: 216px; font-size: 12px; }
      #legend .row { height: 18px; grid-template-columns: minmax(24px, max-content) 1fr 54px; } }`;
  const panel = element(document.body, "div");
  panel.id = "legend";
  const updates = [];

  for (const group of legend.efforts || []) {
    const section = element(panel, "section");
    element(section, "h2", "", group.title);
    const place = (value) => `${50 + 50 * Math.max(-1, Math.min(1, value / group.end))}%`;
    for (const motor of group.motors) {
      const row = element(section, "div", "row");
      element(row, "span", "", motor.name);
      const bar = element(row, "div", "bar");
      bar.style.background = `linear-gradient(to right, ${group.stops.join(", ")})`;
      for (const end of [motor.lower, motor.limit]) {
        if (end !== null && Math.abs(end) < group.end) { element(bar, "b").style.left = place(end); }
      }
      const marker = element(bar, "i");
      const output = element(row, "output");
      updates.push([motor.values, (value) => {
        marker.style.left = place(value);
        output.textContent = signed(value, group.decimals);
        row.classList.toggle("over", (motor.limit !== null && value > motor.limit)
          || (motor.lower !== null && value < motor.lower));
      }]);
    }
    const row = element(section, "div", "row ticks-row");
    row.style.height = "16px";
    element(row, "span");
    const ticks = element(row, "div", "ticks");
    for (const share of [-1, -0.5, 0, 0.5, 1]) {
      const tick = element(ticks, "span", "", (share > 0 ? "+" : "") + short(share * group.end));
      tick.style.left = place(share * group.end);
    }
    /* The names' column is as wide as the longest name in every row. */
    const names = [...section.querySelectorAll(".row > span:first-child")];
    const width = Math.max(...names.map((name) => name.getBoundingClientRect().width));
    for (const name of names) { name.style.minWidth = `${Math.min(width, 90)}px`; }
    const limits = group.motors.filter((motor) => motor.lower !== null || motor.limit !== null);
    if (limits.length > 0) {
      const same = limits.length === group.motors.length
        && limits.every((motor) => motor.lower === limits[0].lower && motor.limit === limits[0].limit);
      const range = (motor) => motor.lower === -motor.limit ? `\u00B1${short(motor.limit)}`
        : `${motor.lower === null ? "\u2212\u221E" : short(motor.lower)} to ${motor.limit === null ? "+\u221E" : short(motor.limit)}`;
      element(section, "p", "note", same ? `limit ${range(limits[0])}`
        : "limits " + limits.map((motor) => `${motor.name} ${range(motor)}`).join(", "));
    }
  }

  if (legend.force !== undefined) {
    const section = element(panel, "section");
    element(section, "h2", "", "force on the foot, N");
    const row = element(section, "div", "force");
    const icon = element(row, "span");
    icon.innerHTML = `<svg width="52" height="12" viewBox="0 0 52 12" style="display:block"><path d="M0 4.5H36V0L52 6 36 12V7.5H0z" fill="${legend.force.colour}"/></svg>`;
    const output = element(row, "output");
    element(section, "p", "note", legend.force.scale);
    const largest = Math.max(...legend.force.values);
    const decimals = largest < 10 ? 2 : 1;
    updates.push([legend.force.values, (value) => { output.textContent = value.toFixed(decimals); }]);
  }

  const refresh = () => {
    for (const [values, show] of updates) {
      const frame = Math.min(viewer.animator.time * legend.rate, values.length - 1);
      const before = Math.floor(frame);
      const after = Math.min(before + 1, values.length - 1);
      show(values[before] + (values[after] - values[before]) * (frame - before));
    }
    requestAnimationFrame(refresh);
  };
  refresh();
}
