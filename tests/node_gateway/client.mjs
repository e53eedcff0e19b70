// The official Fabric Gateway client for Node.js against a ledger: node client.mjs CONNECTION.json SCENARIO [ARGUMENT…]
// Prints one JSON document with what was observed; the judging is done by the test that started it.

import { createHash, createPrivateKey, X509Certificate } from 'node:crypto';
import { readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import * as grpc from '@grpc/grpc-js';
import { checkpointers, connect, hash, signers } from '@hyperledger/fabric-gateway';

const [, , file, scenario, ...rest] = process.argv;
const connection = JSON.parse(readFileSync(file, 'utf8'));
const read = (name) => readFileSync(join(dirname(file), name));
const text = (bytes) => Buffer.from(bytes).toString('utf8');

const tls = connection.client_tls;
const shown = tls ? [read(tls.key), read(tls.certificate)] : [];
const tlsClientCertificateHash = tls && createHash('sha256').update(new X509Certificate(shown[1]).raw).digest();
const client = new grpc.Client(
    connection.gateway.address,
    grpc.credentials.createSsl(read(connection.gateway.tls_ca), ...shown),
    { 'grpc.ssl_target_name_override': connection.gateway.server_name },
);

function identityOf(name) {
    const entry = connection.identities[name];
    return { mspId: entry.msp_id, credentials: read(entry.certificate) };
}

const signerOf = (name) => signers.newPrivateKeySigner(createPrivateKey(read(connection.identities[name].key)));

function gatewayOf(name, { offline = false } = {}) {
    return connect({
        client,
        identity: identityOf(name),
        hash: hash.sha256,
        tlsClientCertificateHash,
        ...(offline ? {} : { signer: signerOf(name) }),
        evaluateOptions: () => ({ deadline: Date.now() + 5000 }),
        endorseOptions: () => ({ deadline: Date.now() + 15000 }),
        submitOptions: () => ({ deadline: Date.now() + 5000 }),
        commitStatusOptions: () => ({ deadline: Date.now() + 20000 }),
    });
}

const contractOf = (gateway) => gateway.getNetwork(connection.channel).getContract(connection.chaincode);

async function failure(action) {
    try {
        await action();
        return { name: null };
    } catch (error) {
        return {
            name: error.constructor.name,
            grpcCode: error.code,
            status: error.cause?.code,
            message: error.message,
            transactionId: error.transactionId,
            details: error.details,
        };
    }
}

const scenarios = {
    // submit, evaluate, the parts of an asynchronous submit, and a transient field
    async transactions() {
        const contract = contractOf(gatewayOf('pad'));
        const submitted = text(await contract.submitTransaction('put', 'node', 'value'));
        const evaluated = text(await contract.evaluateTransaction('get', 'node'));
        const started = await contract.submitAsync('put', { arguments: ['node2', 'async'] });
        const status = await started.getStatus();
        const transient = text(await contract.submit('put', {
            arguments: ['node3', 'with transient'],
            transientData: { secret: Buffer.from('not on the ledger') },
        }));
        return {
            submitted,
            evaluated,
            asynchronous: text(started.getResult()),
            transient,
            transactionId: started.getTransactionId(),
            successful: status.successful,
            code: status.code,
            blockNumber: Number(status.blockNumber),
        };
    },

    // every message is made here and signed elsewhere, and each stage goes through bytes
    async offline() {
        const gateway = gatewayOf('uav', { offline: true });
        const sign = signerOf('uav');
        const unsignedProposal = contractOf(gateway).newProposal('put', { arguments: ['offline', 'signed elsewhere'] });
        const proposal = gateway.newSignedProposal(
            unsignedProposal.getBytes(), await sign(unsignedProposal.getDigest()));
        const evaluated = text(await proposal.evaluate());
        const unsignedTransaction = await proposal.endorse();
        const transaction = gateway.newSignedTransaction(
            unsignedTransaction.getBytes(), await sign(unsignedTransaction.getDigest()));
        const unsignedCommit = await transaction.submit();
        const commit = gateway.newSignedCommit(unsignedCommit.getBytes(), await sign(unsignedCommit.getDigest()));
        const status = await commit.getStatus();
        const unsigned = await failure(() => contractOf(gateway).evaluateTransaction('get', 'offline'));
        return {
            evaluated,
            endorsed: text(transaction.getResult()),
            successful: status.successful,
            unsigned,
        };
    },

    async errors() {
        const contract = contractOf(gatewayOf('pad'));
        const impostor = connect({
            client,
            identity: { mspId: 'PadMSP', credentials: identityOf('uav').credentials },
            signer: signerOf('uav'),
        });
        // Two transactions that read the same version: the later one conflicts.
        const first = contract.newProposal('increment', { arguments: ['counter'] });
        const second = contract.newProposal('increment', { arguments: ['counter'] });
        const transactions = [await first.endorse(), await second.endorse()];
        const commits = [await transactions[0].submit(), await transactions[1].submit()];
        const statuses = [await commits[0].getStatus(), await commits[1].getStatus()];
        return {
            endorse: await failure(() => contract.submitTransaction('refuse', '403', 'NOT_YOURS: ask its operator')),
            evaluate: await failure(() => contract.evaluateTransaction('refuse', '404', 'NOT_FOUND: no such pad')),
            crash: await failure(() => contract.submitTransaction('crash')),
            impostor: await failure(() => contractOf(impostor).submitTransaction('put', 'x', 'y')),
            policy: await failure(() => contract.submit('put', {
                arguments: ['x', 'y'],
                endorsingOrganizations: ['AuthorityMSP'],
            })),
            organisation: await failure(() => contract.submit('put', {
                arguments: ['x', 'y'],
                endorsingOrganizations: ['FleetMSP'],
            })),
            conflict: statuses.map((each) => each.code),
        };
    },

    // events from a checkpoint in a file, so many and no more
    async events(checkpointFile, count) {
        const network = gatewayOf('mirror').getNetwork(connection.channel);
        const checkpointer = await checkpointers.file(checkpointFile);
        const stream = await network.getChaincodeEvents(connection.chaincode, { checkpoint: checkpointer, startBlock: 0n });
        const found = [];
        try {
            for await (const event of stream) {
                found.push([event.eventName, text(event.payload), Number(event.blockNumber), event.transactionId]);
                await checkpointer.checkpointChaincodeEvent(event);
                if (found.length >= Number(count)) break;
            }
        } finally {
            stream.close();
        }
        return { events: found };
    },

    // the same blocks in three forms, from the first one on
    async blocks(count) {
        const network = gatewayOf('mirror').getNetwork(connection.channel);
        const take = async (open, view) => {
            const stream = await open();
            const found = [];
            try {
                for await (const item of stream) {
                    found.push(view(item));
                    if (found.length >= Number(count)) break;
                }
            } finally {
                stream.close();
            }
            return found;
        };
        const startBlock = 0n;
        return {
            full: await take(() => network.getBlockEvents({ startBlock }), (block) => ({
                number: block.getHeader().getNumber(),
                previous: Buffer.from(block.getHeader().getPreviousHash_asU8()).toString('hex'),
                dataHash: Buffer.from(block.getHeader().getDataHash_asU8()).toString('hex'),
                ownDataHash: createHash('sha256').update(
                    Buffer.concat(block.getData().getDataList_asU8().map((each) => Buffer.from(each)))).digest('hex'),
                transactions: block.getData().getDataList().length,
            })),
            filtered: await take(() => network.getFilteredBlockEvents({ startBlock }), (block) => ({
                number: block.getNumber(),
                channel: block.getChannelId(),
                transactions: block.getFilteredTransactionsList().map((each) => [
                    each.getTxid(),
                    each.getTxValidationCode(),
                    (each.getTransactionActions()?.getChaincodeActionsList() ?? []).map(
                        (action) => action.getChaincodeEvent().getEventName()),
                ]),
            })),
            withPrivateData: await take(() => network.getBlockAndPrivateDataEvents({ startBlock }),
                (item) => item.getBlock().getHeader().getNumber()),
        };
    },

    // one block after another from a checkpoint in a file
    async checkpointedBlocks(checkpointFile, count) {
        const network = gatewayOf('mirror').getNetwork(connection.channel);
        const checkpointer = await checkpointers.file(checkpointFile);
        const stream = await network.getFilteredBlockEvents({ checkpoint: checkpointer, startBlock: 0n });
        const numbers = [];
        try {
            for await (const block of stream) {
                numbers.push(block.getNumber());
                await checkpointer.checkpointBlock(BigInt(block.getNumber()));
                if (numbers.length >= Number(count)) break;
            }
        } finally {
            stream.close();
        }
        return { numbers };
    },

    // a stream that was opened for what comes next sees it, and nothing before
    async next() {
        const contract = contractOf(gatewayOf('pad'));
        await contract.submitTransaction('put', 'before', '1', 'Before');
        const stream = await gatewayOf('mirror').getNetwork(connection.channel).getChaincodeEvents(connection.chaincode);
        await contract.submitTransaction('put', 'after', '2', 'After');
        try {
            for await (const event of stream) {
                return { event: event.eventName };
            }
        } finally {
            stream.close();
        }
        return { event: null };
    },
};

try {
    console.log(JSON.stringify(await scenarios[scenario](...rest)));
} finally {
    client.close();
}
