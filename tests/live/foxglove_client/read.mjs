// MCAP's reader in TypeScript reads a recording: node read.mjs FILE
// Writes a line for the header, each metadata record and each decoded message, as they stand in the file, and one for the
// whole: did it end as it must, and which messages does the reader that seeks find by the file's index, in order of time?
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { createReadStream } from "node:fs";
import { open } from "node:fs/promises";
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
say({ whole: whole && reader.done(), sought: await seek(process.argv[2]) });

// running numbers of the messages that it finds; null where the file has no index
async function seek(path) {
  const file = await open(path);
  const size = async () => BigInt((await file.stat()).size);
  const read = async (at, length) => {
    const bytes = new Uint8Array(Number(length));
    await file.read(bytes, 0, bytes.length, Number(at));
    return bytes;
  };
  try {
    const indexed = await McapIndexedReader.Initialize({ readable: { size, read } }).catch(() => null);
    if (indexed === null) return null;
    const found = [];
    for await (const message of indexed.readMessages()) found.push(message.sequence);
    return found;
  } finally {
    await file.close();
  }
}
