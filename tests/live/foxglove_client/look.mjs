// Foxglove's client library looks at a server: node look.mjs URL TOPICS look|orders
// Writes a line for what the server says of itself, for its channels, and for each decoded message, until the server ends.
// In the mode `orders` it asks instead for all that a client can want changed, and writes what it is answered within a second.
import protocol from "@foxglove/ws-protocol"; // CommonJS, whose names Node does not see
import WebSocket from "ws";
import { decoder, line } from "./decode.mjs";

const { FoxgloveClient } = protocol;
const [url, topics, mode] = process.argv.slice(2);
const bytes = (some) => new Uint8Array(some.buffer, some.byteOffset, some.byteLength);
const say = (what) => process.stdout.write(`${line(what)}\n`);

const client = new FoxgloveClient({ ws: new WebSocket(url, ["foxglove.sdk.v1", FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
const channels = new Map();
const subscribed = new Map();

client.on("error", (error) => {
  console.error(error);
  process.exit(1);
});
client.on("close", () => process.exit(0));
client.on("serverInfo", (info) => say({ info }));
client.on("status", (status) => say({ status }));
for (const answer of ["advertiseServices", "parameterValues", "serviceCallResponse", "serviceCallFailure"]) {
  client.on(answer, (what) => say({ answer, what }));
}
client.on("advertise", (some) => {
  for (const one of some) channels.set(one.id, one);
  if (channels.size < Number(topics)) return;
  say({ channels: [...channels.values()].map(({ topic, encoding, schemaName }) => ({ topic, encoding, schemaName })) });
  if (mode === "orders") order();
  else for (const one of channels.values()) subscribe(one);
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { topic, decode } = subscribed.get(subscriptionId);
  say({ topic, stamp: timestamp, message: decode(bytes(data)) });
});

function subscribe({ id, topic, encoding, schemaName, schemaEncoding, schema }) {
  const raw = Buffer.from(schema, schemaEncoding === "protobuf" ? "base64" : "utf8");
  subscribed.set(client.subscribe(id), { topic, decode: decoder(encoding, schemaEncoding, schemaName, raw) });
}

function order() {
  const [own] = channels.keys();
  const data = new TextEncoder().encode("{}");
  const mine = client.advertise({ topic: "/command", encoding: "json", schemaName: "" });
  client.sendMessage(mine, data);
  client.sendMessage(own, data);
  client.setParameters([{ name: "force", value: 100 }], "set");
  client.getParameters([], "get");
  client.subscribeParameterUpdates(["force"]);
  client.sendServiceCallRequest({ serviceId: 1, callId: 1, encoding: "json", data: new DataView(data.buffer) });
  client.fetchAsset("file:///etc/hostname", 1);
  client.subscribeConnectionGraph();
  setTimeout(() => client.close(), 1000);
}
