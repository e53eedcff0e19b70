// The official Fabric Gateway client for Node.js, driven by a test: node bridge.mjs CONNECTION.json
// One JSON object per line comes in ({id, op, behindMs, ...}), one goes out ({id, result} or {id, error}). The client
// is what npm has; only the clock of this process is set back, so that the tests' people share one time.

import { createPrivateKey, X509Certificate } from 'node:crypto';
import { readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { createInterface } from 'node:readline';

const RealDate = Date;
let behindMs = 0;
globalThis.Date = class extends RealDate {
    constructor(...parts) {
        if (parts.length) super(...parts);
        else super(RealDate.now() - behindMs);
    }

    static now() {
        return RealDate.now() - behindMs;
    }
};

const grpc = await import('@grpc/grpc-js');
const { checkpointers, connect, hash, signers } = await import('@hyperledger/fabric-gateway');

const [, , file] = process.argv;
const read = (name) => readFileSync(join(dirname(file), name));
const load = () => JSON.parse(readFileSync(file, 'utf8'));
let connection = load();
const tls = connection.client_tls;
const client = new grpc.Client(
    connection.gateway.address,
    tls ? grpc.credentials.createSsl(read(connection.gateway.tls_ca), read(tls.key), read(tls.certificate))
        : grpc.credentials.createSsl(read(connection.gateway.tls_ca)),
    { 'grpc.ssl_target_name_override': connection.gateway.server_name },
);
const gateways = new Map();
const transactions = new Map();

function gatewayOf(name) {
    if (!gateways.has(name)) {
        connection = load(); // people are enrolled while a test runs
        const entry = connection.identities[name];
        gateways.set(name, connect({
            client,
            identity: { mspId: entry.msp_id, credentials: read(entry.certificate) },
            signer: signers.newPrivateKeySigner(createPrivateKey(read(entry.key))),
            hash: hash.sha256,
            ...(tls ? { tlsClientCertificateHash: hash.sha256(new X509Certificate(read(tls.certificate)).raw) } : {}),
        }));
    }
    return gateways.get(name);
}

const networkOf = (name) => gatewayOf(name).getNetwork(connection.channel);
const contractOf = (name) => networkOf(name).getContract(connection.chaincode);
const text = (bytes) => Buffer.from(bytes).toString('utf8');
const hex = (bytes) => Buffer.from(bytes).toString('hex');

async function take(stream, count, view, seen = async () => {}) {
    const found = [];
    try {
        for await (const item of stream) {
            found.push(view(item));
            await seen(item);
            if (found.length >= count) break;
        }
    } finally {
        stream.close();
    }
    return found;
}

const operations = {
    async evaluate({ who, name, argument }) {
        return { payload: text(await contractOf(who).evaluateTransaction(name, argument)) };
    },

    async endorse({ who, name, argument, endorsedBy }) {
        const options = { arguments: [argument], ...(endorsedBy.length ? { endorsingOrganizations: endorsedBy } : {}) };
        const transaction = await contractOf(who).newProposal(name, options).endorse();
        transactions.set(transaction.getTransactionId(), transaction);
        return { txId: transaction.getTransactionId(), payload: text(transaction.getResult()) };
    },

    async submit({ txId }) {
        const transaction = transactions.get(txId);
        transactions.set(`commit ${txId}`, await transaction.submit());
        return {};
    },

    async status({ txId }) {
        const status = await transactions.get(`commit ${txId}`).getStatus();
        return { code: status.code, successful: status.successful, blockNumber: Number(status.blockNumber) };
    },

    // what the highest-level call makes of it: the contract's answer, or one of the client's errors
    async submitTransaction({ who, name, argument, endorsedBy }) {
        const options = { arguments: [argument], ...(endorsedBy.length ? { endorsingOrganizations: endorsedBy } : {}) };
        return { payload: text(await contractOf(who).submit(name, options)) };
    },

    async events({ who, startBlock, checkpointFile, count }) {
        const checkpoint = await checkpointers.file(checkpointFile);
        const stream = await networkOf(who).getChaincodeEvents(
            connection.chaincode, { checkpoint, startBlock: BigInt(startBlock) });
        return take(stream, count, (event) => ({
            name: event.eventName,
            payload: text(event.payload),
            blockNumber: Number(event.blockNumber),
            txId: event.transactionId,
        }), (event) => checkpoint.checkpointChaincodeEvent(event));
    },

    async blocks({ who, startBlock, count }) {
        const stream = await networkOf(who).getBlockEvents({ startBlock: BigInt(startBlock) });
        return take(stream, count, (block) => ({
            number: block.getHeader().getNumber(),
            previous: hex(block.getHeader().getPreviousHash_asU8()),
            dataHash: hex(block.getHeader().getDataHash_asU8()),
            codes: hex(block.getMetadata().getMetadataList_asU8()[2]),
        }));
    },

    async filteredBlocks({ who, startBlock, count }) {
        const stream = await networkOf(who).getFilteredBlockEvents({ startBlock: BigInt(startBlock) });
        return take(stream, count, (block) => ({
            number: block.getNumber(),
            transactions: block.getFilteredTransactionsList().map((each) => [
                each.getTxid(),
                each.getTxValidationCode(),
                (each.getTransactionActions()?.getChaincodeActionsList() ?? []).map(
                    (action) => action.getChaincodeEvent()?.getEventName() ?? ''),
            ]),
        }));
    },
};

function described(error) {
    return {
        name: error.constructor.name,
        grpcCode: error.code ?? null,
        message: error.message,
        txId: error.transactionId ?? '',
        details: error.details ?? [],
    };
}

const say = (answer) => process.stdout.write(`${JSON.stringify(answer)}\n`);
for await (const line of createInterface({ input: process.stdin })) {
    const { id, op, behindMs: behind, ...request } = JSON.parse(line);
    behindMs = behind;
    operations[op](request).then((result) => say({ id, result }), (error) => say({ id, error: described(error) }));
}
client.close();
process.exit(0);
