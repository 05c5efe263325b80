// Reads an MCAP file by its makers' own JavaScript library: node check.mjs MODULES FILE
import { open } from "node:fs/promises";
import { createReadStream } from "node:fs";
import { createRequire } from "node:module";
import path from "node:path";

const [modules, file] = process.argv.slice(2);
const require = createRequire(path.join(modules, "package.json"));
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");
const { FileHandleReadable } = require("@mcap/nodejs");

const decompressHandlers = await loadDecompressHandlers();

// By the index, which checks the CRC of every chunk that it opens.
const handle = await open(file, "r");
const indexed = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(handle),
  decompressHandlers,
});
const topics = {};
let messages = 0;
let sorted = true;
let last = -1n;
for await (const message of indexed.readMessages({ validateCrcs: true })) {
  const topic = indexed.channelsById.get(message.channelId).topic;
  topics[topic] = (topics[topic] ?? 0) + 1;
  sorted &&= message.logTime >= last;
  last = message.logTime;
  messages += 1;
}
const counted = {};
for (const [id, count] of indexed.statistics.channelMessageCounts) {
  counted[indexed.channelsById.get(id).topic] = Number(count);
}
const schemas = {};
for (const channel of indexed.channelsById.values()) {
  const schema = indexed.schemasById.get(channel.schemaId);
  schemas[channel.topic] = schema === undefined ? null : [schema.name, schema.encoding, schema.data.length];
}
const attachments = [];
for await (const one of indexed.readAttachments()) attachments.push(one.name);
const metadata = [];
for await (const one of indexed.readMetadata()) metadata.push(one.name);
await handle.close();

// From the first byte to the last, with every CRC that there is.
const stream = new McapStreamReader({ decompressHandlers, validateCrcs: true });
const records = {};
for await (const data of createReadStream(file)) {
  stream.append(data);
  for (let record; (record = stream.nextRecord()); ) {
    records[record.type] = (records[record.type] ?? 0) + 1;
  }
}

console.log(
  JSON.stringify({
    messages,
    topics,
    counted,
    sorted,
    schemas,
    attachments,
    metadata,
    statistics: Number(indexed.statistics.messageCount),
    streamed: records.Message,
    done: stream.done(),
    left: stream.bytesRemaining(),
  }),
);
