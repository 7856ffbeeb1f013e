// Puts Meta's WebXR emulator into the page, paces it, and drives the headset along a known path.
// window.RIG = {device, rateHz}, set before this runs.
(() => {
  const { XRDevice, metaQuest2, metaQuestPro, metaQuest3 } = window.IWER;
  const profile = { metaQuest2, metaQuestPro, metaQuest3 }[window.RIG.device];
  const device = new XRDevice(profile);
  device.installRuntime({ forceInstall: true });

  // The emulator asks for window frames, 60 a second at most; a message channel has no such limit.
  const period = 1000 / window.RIG.rateHz;
  const channel = new MessageChannel();
  let wanted = new Map(), handle = 0, due = performance.now();
  channel.port1.onmessage = () => {
    const now = performance.now();
    if (now >= due && wanted.size) {
      due = Math.max(due + period, now - period);
      const callbacks = [...wanted.values()];
      wanted.clear();
      for (const callback of callbacks) callback(now);
    }
    if (wanted.size) channel.port2.postMessage(0);
  };
  window.requestAnimationFrame = (callback) => {
    wanted.set(++handle, callback);
    channel.port2.postMessage(0);
    return handle;
  };
  window.cancelAnimationFrame = (id) => wanted.delete(id);

  // The emulator's local space has its origin where its headset starts.
  const EYES = device.position.y;

  // The pose that frame k has, for the page and, written the same way, for the test.
  const path = (k) => {
    const a = 0.05 * k, b = 0.031 * k, half = 0.5 * Math.sin(0.02 * k);
    const axis = [Math.sin(a), Math.cos(a) * Math.cos(b), Math.cos(a) * Math.sin(b)];
    const s = Math.sin(half);
    return [
      0.3 * Math.sin(0.021 * k), 0.1 * Math.cos(0.017 * k), -0.2 + 0.25 * Math.sin(0.013 * k + 1),
      axis[0] * s, axis[1] * s, axis[2] * s, Math.cos(half),
    ];
  };
  let frame = 0;
  window.INJECTED = { device, path, frames: () => frame, events: [] };
  const request = XRSession.prototype.requestAnimationFrame;
  XRSession.prototype.requestAnimationFrame = function (callback) {
    return request.call(this, (time, xrFrame) => {
      callback(time, xrFrame);
      // what the next frame will show
      frame += 1;
      place(frame);
    });
  };
  const place = (k) => {
    const [x, y, z, qx, qy, qz, qw] = path(k);
    device.position.set(x, y + EYES, z);
    device.quaternion.set(qx, qy, qz, qw);
  };
})();
