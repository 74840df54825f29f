// Messages as Foxglove decodes them: by the schema that came with their channel, each by the library for its language.
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import protobuf from "protobufjs";
import "protobufjs/ext/descriptor.js";

const text = new TextDecoder("utf-8", { fatal: true });

// encoding of the messages, language of the schema, its name, and the schema as bytes -> bytes of a message -> what it says
export function decoder(encoding, language, name, schema) {
  if (encoding === "json" && language === "jsonschema") {
    JSON.parse(text.decode(schema));
    return (data) => JSON.parse(text.decode(data));
  }
  if (encoding === "cdr" && language === "ros2msg") {
    const reader = new MessageReader(parse(text.decode(schema), { ros2: true }));
    return (data) => reader.readMessage(data);
  }
  if (encoding === "protobuf" && language === "protobuf") {
    const set = protobuf.descriptor.FileDescriptorSet.decode(schema);
    const type = protobuf.Root.fromDescriptor(set).lookupType(name);
    return (data) => type.toObject(type.decode(data), { longs: String, bytes: String, defaults: true });
  }
  throw new Error(`nobody decodes ${encoding} by ${language}`);
}

// a line of JSON with all digits of numbers, lists for typed arrays, and the nanoseconds of large integers as text
export function line(what) {
  return JSON.stringify(what, (_, value) => {
    if (typeof value === "bigint") return value.toString();
    return ArrayBuffer.isView(value) ? Array.from(value) : value;
  });
}
