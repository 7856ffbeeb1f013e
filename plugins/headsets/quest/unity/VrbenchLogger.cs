// Logs the pose of the headset's centre eye for vrbench: every frame, twice, into a file on the
// headset and by UDP to the recorder. Put it on one GameObject of an empty XR scene; see README.md.
// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Concurrent;
using System.Collections.Generic;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Net;
using System.Net.Sockets;
using System.Text;
using System.Threading;
using UnityEngine;
using UnityEngine.XR;

namespace Vrbench
{
    public sealed class VrbenchLogger : MonoBehaviour
    {
        [Tooltip("The recorder's address; an extra of the intent that starts the app goes before it.")]
        public string host = "";
        public int port = 9750;
        [Tooltip("The session's token, 16 hexadecimal digits, as the recorder prints it.")]
        public string token = "";

        const byte Version = 1;
        const byte Hello = 1, Poses = 2, Pong = 3, Done = 4, Happened = 5;
        const byte Ping = 16, Start_ = 17, Stop = 18;
        const int HeadBytes = 14;
        // OpenXR's location flags, as vrbench has them.
        const int OrientationValid = 1, PositionValid = 2, OrientationTracked = 4, PositionTracked = 8;
        const int FlushMs = 500, GreetMs = 1000;
        const string Columns =
            "time_ns,frame,moment,x,y,z,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz,flags,present,epoch";
        static readonly CultureInfo Plain = CultureInfo.InvariantCulture;

        struct Sample
        {
            public long time;
            public int frame;
            public byte moment; // 0 in Update, 1 right before rendering
            public byte flags;
            public byte present; // 0 no, 1 yes, 2 not told
            public uint epoch;
            public Vector3 p, v, w;
            public Quaternion q;
        }

        // What the main thread hands to the writer, in order: a sample, or a line of text.
        struct Entry
        {
            public bool isSample;
            public Sample sample;
            public string line;      // of the log
            public string open;      // name of a take that begins
            public byte[] token;     // of that take
            public bool close;       // the take ends
        }

        readonly string run = Guid.NewGuid().ToString("N");
        readonly ConcurrentQueue<Entry> entries = new ConcurrentQueue<Entry>();
        readonly ConcurrentQueue<Action> orders = new ConcurrentQueue<Action>();
        readonly AutoResetEvent wake = new AutoResetEvent(false);
        readonly HashSet<uint> done = new HashSet<uint>();
        readonly List<XRInputSubsystem> subsystems = new List<XRInputSubsystem>();
        readonly object sending = new object();
        byte[] takeToken = new byte[8]; // the writer's
        byte[] sessionToken = new byte[8];
        long utcOriginNs;
        InputDevice eye;
        uint epoch;
        uint sampleNumber;
        uint eventNumber;
        volatile bool taking;
        volatile bool running = true;
        string facts = "{}";
        string header = "";
        string folder = "";
        UdpClient udp;
        IPEndPoint recorder;
        Thread writer, listener;

        // Nanoseconds of a clock that nobody sets. Ticks are divided in two parts: a product would overflow.
        static long Now()
        {
            long ticks = Stopwatch.GetTimestamp();
            long whole = ticks / Stopwatch.Frequency, part = ticks % Stopwatch.Frequency;
            return whole * 1000000000L + part * 1000000000L / Stopwatch.Frequency;
        }

        static long UtcNs()
        {
            return (DateTime.UtcNow.Ticks - 621355968000000000L) * 100L;
        }

        void Awake()
        {
            Application.runInBackground = true;
            Screen.sleepTimeout = SleepTimeout.NeverSleep;
            ReadIntent();
            utcOriginNs = AnchorUtc();
            folder = Application.persistentDataPath;
            sessionToken = FromHex(token);
            DescribeDevice();
            if (IPAddress.TryParse(host, out IPAddress address))
            {
                recorder = new IPEndPoint(address, port);
                udp = new UdpClient(address.AddressFamily);
                udp.Client.ReceiveTimeout = 200;
                if (address.AddressFamily == AddressFamily.InterNetwork)
                    udp.Client.Bind(new IPEndPoint(IPAddress.Any, 0));
                else
                    udp.Client.Bind(new IPEndPoint(IPAddress.IPv6Any, 0));
                listener = new Thread(Listen) { IsBackground = true, Name = "vrbench listener" };
                listener.Start();
            }
            writer = new Thread(Write) { IsBackground = true, Name = "vrbench writer" };
            writer.Start();
        }

        void OnEnable()
        {
            Application.onBeforeRender += BeforeRender;
            InputDevices.deviceConnected += DeviceConnected;
        }

        void OnDisable()
        {
            Application.onBeforeRender -= BeforeRender;
            InputDevices.deviceConnected -= DeviceConnected;
            foreach (XRInputSubsystem subsystem in subsystems) subsystem.trackingOriginUpdated -= Recentred;
            subsystems.Clear();
        }

        void OnDestroy()
        {
            running = false;
            wake.Set();
            if (writer != null) writer.Join(2000);
            if (listener != null) listener.Join(1000);
            if (udp != null) udp.Close();
        }

        void Update()
        {
            WatchOrigin();
            while (orders.TryDequeue(out Action order)) order();
            Take(0);
        }

        [BeforeRenderOrder(10000)] // after everything that still moves the camera
        void BeforeRender()
        {
            Take(1);
        }

        void OnApplicationPause(bool paused)
        {
            Tell(paused ? "pause" : "resume", "");
        }

        void OnApplicationFocus(bool focused)
        {
            Tell(focused ? "focus" : "unfocus", "");
        }

        void DeviceConnected(InputDevice device)
        {
            Tell("device", device.name);
        }

        void Recentred(XRInputSubsystem subsystem)
        {
            epoch += 1;
            Tell("reset", "epoch " + epoch.ToString(Plain));
        }

        // Subsystems come and go with the session, and each tells its own recentres.
        void WatchOrigin()
        {
            if (Time.frameCount % 60 != 1) return;
            var found = new List<XRInputSubsystem>();
            SubsystemManager.GetSubsystems(found);
            foreach (XRInputSubsystem subsystem in found)
            {
                if (subsystems.Contains(subsystem)) continue;
                subsystem.trackingOriginUpdated += Recentred;
                subsystems.Add(subsystem);
            }
        }

        void Take(byte moment)
        {
            if (!taking) return;
            if (!eye.isValid) eye = InputDevices.GetDeviceAtXRNode(XRNode.CenterEye);
            var sample = new Sample
            {
                time = Now(), frame = Time.frameCount, moment = moment, epoch = epoch, q = Quaternion.identity,
                present = 2,
            };
            if (eye.isValid)
            {
                InputTrackingState state = InputTrackingState.None;
                bool tracked = false;
                eye.TryGetFeatureValue(CommonUsages.trackingState, out state);
                eye.TryGetFeatureValue(CommonUsages.isTracked, out tracked);
                if (!eye.TryGetFeatureValue(CommonUsages.centerEyePosition, out sample.p)) state &= ~InputTrackingState.Position;
                if (!eye.TryGetFeatureValue(CommonUsages.centerEyeRotation, out sample.q))
                {
                    state &= ~InputTrackingState.Rotation;
                    sample.q = Quaternion.identity;
                }
                if (!eye.TryGetFeatureValue(CommonUsages.centerEyeVelocity, out sample.v)) sample.v = NoVector;
                if (!eye.TryGetFeatureValue(CommonUsages.centerEyeAngularVelocity, out sample.w)) sample.w = NoVector;
                if (eye.TryGetFeatureValue(CommonUsages.userPresence, out bool present)) sample.present = (byte)(present ? 1 : 0);
                int flags = 0;
                if ((state & InputTrackingState.Position) != 0) flags |= PositionValid | (tracked ? PositionTracked : 0);
                if ((state & InputTrackingState.Rotation) != 0) flags |= OrientationValid | (tracked ? OrientationTracked : 0);
                sample.flags = (byte)flags;
            }
            entries.Enqueue(new Entry { isSample = true, sample = sample });
            if (moment == 1) wake.Set();
        }

        static readonly Vector3 NoVector = new Vector3(float.NaN, float.NaN, float.NaN);

        // An event: into the log, and by UDP.
        void Tell(string kind, string detail)
        {
            long time = Now();
            string text = (kind + " " + detail).Replace('\n', ' ').Replace('\r', ' ');
            if (taking) entries.Enqueue(new Entry { line = "# event " + time.ToString(Plain) + " " + text });
            using (var body = new MemoryStream())
            using (var to = new BinaryWriter(body))
            {
                to.Write(eventNumber++);
                to.Write(time);
                to.Write(Encoding.UTF8.GetBytes(text));
                Send(Happened, sessionToken, body.ToArray());
            }
        }

        // ---- The writer: the file, and the datagrams of poses ----

        void Write()
        {
            StreamWriter log = null;
            var line = new StringBuilder(256);
            var batch = new List<Sample>();
            long flushed = Now(), greeted = 0;
            while (running || !entries.IsEmpty)
            {
                wake.WaitOne(20);
                while (entries.TryDequeue(out Entry entry))
                {
                    if (entry.open != null)
                    {
                        SendPoses(batch);
                        log = Open(entry.open, log);
                        takeToken = entry.token;
                        sampleNumber = 0;
                    }
                    if (entry.line != null && log != null) log.WriteLine(entry.line);
                    if (entry.isSample)
                    {
                        if (log != null) log.WriteLine(Line(line, entry.sample));
                        batch.Add(entry.sample);
                        if (batch.Count == 16) SendPoses(batch);
                    }
                    if (entry.close)
                    {
                        SendPoses(batch);
                        if (log != null) log.Dispose();
                        log = null;
                    }
                }
                SendPoses(batch);
                long now = Now();
                if (log != null && now - flushed > FlushMs * 1000000L)
                {
                    log.Flush();
                    flushed = now;
                }
                if (now - greeted > GreetMs * 1000000L)
                {
                    Send(Hello, sessionToken, Encoding.UTF8.GetBytes(facts));
                    greeted = now;
                }
            }
            if (log != null) log.Dispose();
        }

        StreamWriter Open(string take, StreamWriter before)
        {
            if (before != null) before.Dispose();
            var name = new StringBuilder();
            foreach (char c in take) name.Append(char.IsLetterOrDigit(c) || c == '.' || c == '-' || c == '_' ? c : '_');
            string stamp = DateTime.UtcNow.ToString("yyyyMMdd'T'HHmmssfff'Z'", Plain);
            string path = Path.Combine(folder, name + "." + stamp + ".csv");
            var log = new StreamWriter(path, false, new UTF8Encoding(false)) { NewLine = "\n" };
            log.Write(header);
            log.WriteLine("# take: " + take.Replace('\n', ' '));
            log.WriteLine(Columns);
            return log;
        }

        static string Line(StringBuilder line, Sample s)
        {
            line.Clear();
            line.Append(s.time.ToString(Plain)).Append(',').Append(s.frame.ToString(Plain)).Append(',');
            line.Append(s.moment == 0 ? "update" : "render");
            foreach (float x in new[] { s.p.x, s.p.y, s.p.z, s.q.x, s.q.y, s.q.z, s.q.w, s.v.x, s.v.y, s.v.z, s.w.x, s.w.y, s.w.z })
                line.Append(',').Append(x.ToString("R", Plain));
            line.Append(',').Append(s.flags).Append(',').Append(s.present).Append(',').Append(s.epoch.ToString(Plain));
            return line.ToString();
        }

        void SendPoses(List<Sample> batch)
        {
            if (batch.Count == 0) return;
            using (var body = new MemoryStream())
            using (var to = new BinaryWriter(body))
            {
                to.Write(sampleNumber);
                to.Write((ushort)batch.Count);
                foreach (Sample s in batch)
                {
                    to.Write(s.time);
                    to.Write(s.moment);
                    to.Write(s.flags);
                    to.Write(s.present);
                    to.Write((byte)0);
                    to.Write(s.epoch);
                    foreach (float x in new[] { s.p.x, s.p.y, s.p.z, s.q.x, s.q.y, s.q.z, s.q.w, s.v.x, s.v.y, s.v.z, s.w.x, s.w.y, s.w.z })
                        to.Write(x);
                }
                Send(Poses, takeToken, body.ToArray());
            }
            sampleNumber += (uint)batch.Count;
            batch.Clear();
        }

        void Send(byte kind, byte[] belongs, byte[] body)
        {
            if (udp == null) return;
            var data = new byte[HeadBytes + body.Length];
            data[0] = (byte)'V'; data[1] = (byte)'R'; data[2] = (byte)'B'; data[3] = (byte)'Q';
            data[4] = Version;
            data[5] = kind;
            Buffer.BlockCopy(belongs, 0, data, 6, 8);
            Buffer.BlockCopy(body, 0, data, HeadBytes, body.Length);
            try
            {
                lock (sending) udp.Send(data, data.Length, recorder);
            }
            catch (SocketException) { } // the network is away: the file has everything
            catch (ObjectDisposedException) { }
        }

        // ---- The listener: pings and commands of the recorder ----

        void Listen()
        {
            var from = new IPEndPoint(IPAddress.Any, 0);
            while (running)
            {
                byte[] data;
                try
                {
                    data = udp.Receive(ref from);
                }
                catch (SocketException)
                {
                    continue;
                }
                catch (ObjectDisposedException)
                {
                    return;
                }
                long received = Now();
                if (IsOurs(data, from)) Obey(data, received);
            }
        }

        bool IsOurs(byte[] data, IPEndPoint from)
        {
            if (data.Length < HeadBytes + 4 || !from.Address.Equals(recorder.Address)) return false;
            if (data[0] != 'V' || data[1] != 'R' || data[2] != 'B' || data[3] != 'Q' || data[4] != Version) return false;
            int different = 0;
            for (int i = 0; i < 8; i++) different |= data[6 + i] ^ sessionToken[i];
            return different == 0;
        }

        void Obey(byte[] data, long received)
        {
            uint number = BitConverter.ToUInt32(data, HeadBytes);
            int rest = HeadBytes + 4;
            switch (data[5])
            {
                case Ping:
                    var answer = new byte[20];
                    Buffer.BlockCopy(BitConverter.GetBytes(number), 0, answer, 0, 4);
                    Buffer.BlockCopy(BitConverter.GetBytes(received), 0, answer, 4, 8);
                    Buffer.BlockCopy(BitConverter.GetBytes(Now()), 0, answer, 12, 8);
                    Send(Pong, sessionToken, answer);
                    return;
                case Start_:
                    if (data.Length < rest + 8 || !done.Add(number)) break;
                    var fresh = new byte[8];
                    Buffer.BlockCopy(data, rest, fresh, 0, 8);
                    string take = Encoding.UTF8.GetString(data, rest + 8, data.Length - rest - 8);
                    orders.Enqueue(() => Begin(take, fresh));
                    break;
                case Stop:
                    if (done.Add(number)) orders.Enqueue(End);
                    break;
                default:
                    return;
            }
            Send(Done, sessionToken, BitConverter.GetBytes(number));
        }

        // Orders are carried out in Update, so that a take has whole frames.
        void Begin(string take, byte[] fresh)
        {
            if (taking) End();
            entries.Enqueue(new Entry { open = take, token = fresh });
            taking = true;
        }

        void End()
        {
            taking = false;
            entries.Enqueue(new Entry { close = true });
            wake.Set();
        }

        // ---- What is known before the first frame ----

        // The narrowest of a few brackets: a pause between two readings would stay in all times.
        static long AnchorUtc()
        {
            long best = long.MaxValue, origin = 0;
            for (int i = 0; i < 20; i++)
            {
                long before = Now(), utc = UtcNs(), after = Now();
                if (after - before >= best) continue;
                best = after - before;
                origin = utc - (before + after) / 2;
            }
            return origin;
        }

        void DescribeDevice()
        {
            float rate = XRDevice.refreshRate;
            var known = new Dictionary<string, string>
            {
                { "run", run },
                { "model", SystemInfo.deviceModel },
                { "os", SystemInfo.operatingSystem },
                { "app", Application.identifier + " " + Application.version },
                { "unity", Application.unityVersion },
                { "runtime", XRSettings.loadedDeviceName },
                { "rate_hz", rate.ToString("R", Plain) },
                { "axes", "unity" },
                { "clock", "Stopwatch, " + Stopwatch.Frequency.ToString(Plain) + " ticks a second" },
                { "prediction", "as the runtime predicts for display" },
            };
            var json = new StringBuilder("{\"utc_origin_ns\":" + utcOriginNs.ToString(Plain));
            var lines = new StringBuilder("# vrbench-log 1\n# utc_origin_ns: " + utcOriginNs.ToString(Plain) + "\n");
            foreach (KeyValuePair<string, string> fact in known)
            {
                json.Append(",\"").Append(fact.Key).Append("\":\"").Append(Quoted(fact.Value)).Append('"');
                lines.Append("# ").Append(fact.Key).Append(": ").Append((fact.Value ?? "").Replace('\n', ' ')).Append('\n');
            }
            facts = json.Append('}').ToString();
            header = lines.ToString();
        }

        static string Quoted(string text)
        {
            var quoted = new StringBuilder();
            foreach (char c in text ?? "")
            {
                if (c == '"' || c == '\\') quoted.Append('\\').Append(c);
                else quoted.Append(c < ' ' ? ' ' : c);
            }
            return quoted.ToString();
        }

        static byte[] FromHex(string text)
        {
            var bytes = new byte[8];
            if (text == null || text.Length != 16) return bytes;
            for (int i = 0; i < 8; i++)
                byte.TryParse(text.Substring(2 * i, 2), NumberStyles.HexNumber, Plain, out bytes[i]);
            return bytes;
        }

        // `adb shell am start ... -e vrbench_host H -e vrbench_port P -e vrbench_token T`
        void ReadIntent()
        {
#if UNITY_ANDROID && !UNITY_EDITOR
            using (var player = new AndroidJavaClass("com.unity3d.player.UnityPlayer"))
            using (var activity = player.GetStatic<AndroidJavaObject>("currentActivity"))
            using (var intent = activity.Call<AndroidJavaObject>("getIntent"))
            {
                host = intent.Call<string>("getStringExtra", "vrbench_host") ?? host;
                token = intent.Call<string>("getStringExtra", "vrbench_token") ?? token;
                string number = intent.Call<string>("getStringExtra", "vrbench_port");
                if (number != null && int.TryParse(number, NumberStyles.Integer, Plain, out int given)) port = given;
            }
#endif
        }
    }
}
