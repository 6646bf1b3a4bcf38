import java.net.DatagramPacket;
import java.net.DatagramSocket;
import java.net.InetAddress;
import java.nio.charset.StandardCharsets;
import java.util.UUID;
import java.util.concurrent.ConcurrentHashMap;
import org.apache.flink.api.common.functions.OpenContext;
import org.apache.flink.api.common.state.ValueState;
import org.apache.flink.api.common.state.ValueStateDescriptor;
import org.apache.flink.streaming.api.environment.StreamExecutionEnvironment;
import org.apache.flink.streaming.api.functions.KeyedProcessFunction;
import org.apache.flink.streaming.api.functions.sink.v2.DiscardingSink;
import org.apache.flink.util.Collector;

/** The job of `job.py` in Flink's Java API. Arguments: the port of the source, the address of the reports. */
public class FlinkJob {
    static final double METRES_PER_DEGREE = 111_000.0, Q = 1.0, R_X = 1.0, R_V = 0.04, GATE = 13.8;

    static String vehicle(String line) {
        int from = line.indexOf('"') + 1;
        return line.substring(from, line.indexOf('"', from));
    }

    static class Judge extends KeyedProcessFunction<String, String, Boolean> {
        private final String reports;
        private transient ValueState<double[]> filter;
        private transient ConcurrentHashMap<Long, Long> buckets;
        private transient volatile long judged, alarms;

        Judge(String reports) {
            this.reports = reports;
        }

        @Override
        public void open(OpenContext context) {
            filter = getRuntimeContext().getState(new ValueStateDescriptor<>("filter", double[].class));
            buckets = new ConcurrentHashMap<>();
            Thread thread = new Thread(this::report);
            thread.setDaemon(true);
            thread.start();
        }

        @Override
        public void processElement(String line, Context context, Collector<Boolean> out) throws Exception {
            String[] fields = line.substring(1, line.length() - 1).split(",");
            long tUs = Long.parseLong(fields[3]);
            double x = Double.parseDouble(fields[4]) * METRES_PER_DEGREE, v = Double.parseDouble(fields[6]);
            double[] s = filter.value();
            boolean isAlarm = false;
            if (s == null) {
                s = new double[] {tUs, x, v, R_X, 0.0, R_V};
            } else {
                isAlarm = step(s, tUs, x, v);
            }
            filter.update(s);
            judged++;
            alarms += isAlarm ? 1 : 0;
            long late = Math.max(System.currentTimeMillis() * 1000 - tUs, 1);
            long edge = late | (1L << Math.max(0, 64 - Long.numberOfLeadingZeros(late) - 5)) - 1;
            buckets.merge(edge, 1L, Long::sum);
            out.collect(isAlarm);
        }

        /** As `job.step`: changes the state in place. */
        static boolean step(double[] s, long tUs, double xM, double vMps) {
            double dt = (tUs - s[0]) / 1e6, x = s[1] + s[2] * dt, v = s[2];
            double pxx = s[3] + dt * (2 * s[4] + dt * s[5]) + Q * dt * dt * dt * dt / 4;
            double pxv = s[4] + dt * s[5] + Q * dt * dt * dt / 2, pvv = s[5] + Q * dt * dt;
            double sxx = pxx + R_X, svv = pvv + R_V, det = sxx * svv - pxv * pxv, dx = xM - x, dv = vMps - v;
            double nis = (svv * dx * dx - 2 * pxv * dx * dv + sxx * dv * dv) / det;
            double kxx = (pxx * svv - pxv * pxv) / det, kxv = pxv * R_X / det;
            double kvx = pxv * R_V / det, kvv = (pvv * sxx - pxv * pxv) / det;
            s[0] = tUs;
            s[1] = x + kxx * dx + kxv * dv;
            s[2] = v + kvx * dx + kvv * dv;
            s[3] = kxx * R_X;
            s[4] = kxv * R_V;
            s[5] = kvv * R_V;
            return nis > GATE;
        }

        private void report() {
            String id = UUID.randomUUID().toString();
            String[] to = reports.split(":");
            try (DatagramSocket socket = new DatagramSocket()) {
                while (true) {
                    Thread.sleep(250);
                    StringBuilder pairs = new StringBuilder();
                    buckets.forEach((edge, count) -> pairs.append(pairs.length() > 0 ? "," : "").append("[" + edge + "," + count + "]"));
                    String text = "{\"instance\":\"" + id + "\",\"judged\":" + judged + ",\"alarms\":" + alarms + ",\"buckets\":[" + pairs + "]}";
                    byte[] bytes = text.getBytes(StandardCharsets.UTF_8);
                    socket.send(new DatagramPacket(bytes, bytes.length, InetAddress.getByName(to[0]), Integer.parseInt(to[1])));
                }
            } catch (Exception error) {
                throw new RuntimeException(error);
            }
        }
    }

    public static void main(String[] arguments) throws Exception {
        StreamExecutionEnvironment environment = StreamExecutionEnvironment.getExecutionEnvironment();
        environment.setParallelism(1);
        environment.setBufferTimeout(1);
        environment.socketTextStream("127.0.0.1", Integer.parseInt(arguments[0]))
            .keyBy(FlinkJob::vehicle)
            .process(new Judge(arguments[1]))
            .sinkTo(new DiscardingSink<>());
        environment.execute("peer");
    }
}
