// MCAP's reader in TypeScript reads a recording: node read.mjs FILE
// Writes a line for the header, each metadata record and each decoded message, and one for the whole.
import { McapStreamReader } from "@mcap/core";
import { createReadStream } from "node:fs";
import { decoder, line } from "./decode.mjs";

const say = (what) => process.stdout.write(`${line(what)}\n`);
const reader = new McapStreamReader({ validateCrcs: true });
const [schemas, channels, decoders] = [new Map(), new Map(), new Map()];
let whole = false;

function take(record) {
  switch (record.type) {
    case "Header":
      say({ header: { profile: record.profile, library: record.library } });
      break;
    case "Metadata":
      say({ metadata: { name: record.name, values: Object.fromEntries(record.metadata) } });
      break;
    case "Schema":
      schemas.set(record.id, record);
      break;
    case "Channel": {
      const { name, encoding, data } = schemas.get(record.schemaId);
      channels.set(record.id, record);
      decoders.set(record.id, decoder(record.messageEncoding, encoding, name, data));
      break;
    }
    case "Message": {
      const { topic } = channels.get(record.channelId);
      const { logTime, publishTime, sequence } = record;
      say({ topic, logTime, publishTime, sequence, message: decoders.get(record.channelId)(record.data) });
      break;
    }
    case "Footer":
      whole = true;
      break;
  }
}

for await (const data of createReadStream(process.argv[2])) {
  reader.append(data);
  for (let record; (record = reader.nextRecord()); ) take(record);
}
say({ whole: whole && reader.done() });
