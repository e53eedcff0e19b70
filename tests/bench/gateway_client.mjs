// The official Fabric Gateway client, driven line by line: {"function", "arguments": [[…], …]} in, milliseconds out.
// Usage: node gateway_client.mjs <directory with node_modules> <ledger directory> <identity>
import crypto from "node:crypto";
import fs from "node:fs";
import { createRequire } from "node:module";
import path from "node:path";
import readline from "node:readline";

const [modules, home, name] = process.argv.slice(2);
const require = createRequire(path.join(modules, "package.json"));
const grpc = require("@grpc/grpc-js");
const { connect, hash, signers } = require("@hyperledger/fabric-gateway");

const read = (file) => fs.readFileSync(path.resolve(home, file));
const connection = JSON.parse(read("connection.json"));
const identity = connection.identities[name];
const tls = connection.client_tls;
const shown = tls ? [read(tls.key), read(tls.certificate)] : [];
const credentials = grpc.credentials.createSsl(read(connection.gateway.tls_ca), ...shown);
const client = new grpc.Client(connection.gateway.address, credentials, {
    "grpc.ssl_target_name_override": connection.gateway.server_name,
    "grpc.default_authority": connection.gateway.server_name,
});
const gateway = connect({
    client,
    identity: { mspId: identity.msp_id, credentials: read(identity.certificate) },
    signer: signers.newPrivateKeySigner(crypto.createPrivateKey(read(identity.key))),
    hash: hash.sha256,
    tlsClientCertificateHash: tls && crypto.createHash("sha256").update(new crypto.X509Certificate(shown[1]).raw).digest(),
});
const contract = gateway.getNetwork(connection.channel).getContract(connection.chaincode);
const say = (value) => process.stdout.write(JSON.stringify(value) + "\n");

say({ ready: true });
for await (const line of readline.createInterface({ input: process.stdin })) {
    const work = JSON.parse(line);
    const took = [];
    for (const argument of work.arguments) {
        const start = process.hrtime.bigint();
        await contract.submitTransaction(work.function, argument);
        took.push(Number(process.hrtime.bigint() - start) / 1e6);
    }
    say({ took_ms: took });
}
gateway.close();
client.close();
