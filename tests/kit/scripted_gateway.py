"""A Gateway whose answers a test lines up by method."""

from __future__ import annotations

import asyncio
import contextlib

import grpc
from fabric_protos.common import common_pb2
from fabric_protos.gateway import gateway_pb2
from fabric_protos.peer import events_pb2, proposal_pb2, proposal_response_pb2
from google.rpc import status_pb2


class FailError(Exception):
    def __init__(self, code, text="", trailers=()):
        super().__init__(text)
        self.code, self.text, self.trailers = code, text, trailers


UNAVAILABLE = FailError(grpc.StatusCode.UNAVAILABLE, "connection reset")


def details(*messages):
    status = status_pb2.Status(code=10, message="see details")
    for message in messages:
        status.details.add().Pack(gateway_pb2.ErrorDetail(address="peer:1", msp_id="PadMSP", message=message))
    return (("grpc-status-details-bin", status.SerializeToString()),)


class Scripted:
    """A Gateway whose answers a test lines up by method. An answer is bytes, a FailError, or a function of the request."""

    def __init__(self, maker):
        self.maker = maker
        self.calls = []
        self.script = {}
        self.newest = 7

    def line_up(self, method, *answers):
        self.script.setdefault(method, []).extend(answers)

    def counted(self, method):
        return sum(name == method for name, _ in self.calls)

    async def answer(self, method, request, context):
        self.calls.append((method, request))
        queue = self.script.get(method, [])
        answer = queue.pop(0) if queue else getattr(self, f"default_{method.lower()}")
        if callable(answer):
            answer = answer(request)
        if asyncio.iscoroutine(answer):
            answer = await answer
        if isinstance(answer, FailError):
            context.set_trailing_metadata(answer.trailers)
            await context.abort(answer.code, answer.text)
        return answer

    def default_evaluate(self, _request):
        result = proposal_response_pb2.Response(status=200, payload=b"evaluated")
        return gateway_pb2.EvaluateResponse(result=result).SerializeToString()

    def default_endorse(self, request):
        return self.endorsed(request)

    def endorsed(self, data, header=None, payload=None):
        request = gateway_pb2.EndorseRequest.FromString(data)
        proposal = proposal_pb2.Proposal.FromString(request.proposed_transaction.proposal_bytes)
        ours = common_pb2.Header.FromString(proposal.header)
        envelope = common_pb2.Envelope.FromString(
            self.maker.transaction(header=header or ours, transient_free=payload or proposal.payload)
        )
        envelope.signature = b""
        return gateway_pb2.EndorseResponse(prepared_transaction=envelope).SerializeToString()

    def default_submit(self, _request):
        return b""

    def default_commitstatus(self, _request):
        return gateway_pb2.CommitStatusResponse(result=0, block_number=9).SerializeToString()

    async def deliver(self, requests, context, method):
        async for data in requests:
            self.calls.append((method, data))
            queue = self.script.get(method, [])
            newest = events_pb2.DeliverResponse(filtered_block=events_pb2.FilteredBlock(number=self.newest))
            for answer in queue.pop(0) if queue else [newest]:
                if isinstance(answer, FailError):
                    await context.abort(answer.code, answer.text)
                if answer is None:
                    await asyncio.Event().wait()
                yield answer if isinstance(answer, bytes) else answer.SerializeToString()
            return


@contextlib.asynccontextmanager
async def serving(scripted):
    """That Gateway, listening; its port is in `scripted.port`."""

    def unary(method):
        async def handle(request, context):
            return await scripted.answer(method, request, context)

        return grpc.unary_unary_rpc_method_handler(handle)

    def deliver(method):
        async def handle(requests, context):
            async for answer in scripted.deliver(requests, context, method):
                yield answer

        return grpc.stream_stream_rpc_method_handler(handle)

    async def chaincode_events(request, context):
        async def once():
            yield request

        async for answer in scripted.deliver(once(), context, "ChaincodeEvents"):
            yield answer

    running = grpc.aio.server()
    handlers = {name: unary(name) for name in ("Evaluate", "Endorse", "Submit", "CommitStatus")}
    handlers["ChaincodeEvents"] = grpc.unary_stream_rpc_method_handler(chaincode_events)
    streams = {name: deliver(name) for name in ("Deliver", "DeliverFiltered")}
    running.add_generic_rpc_handlers(
        (
            grpc.method_handlers_generic_handler("gateway.Gateway", handlers),
            grpc.method_handlers_generic_handler("protos.Deliver", streams),
        )
    )
    scripted.port = running.add_insecure_port("127.0.0.1:0")
    await running.start()
    try:
        yield scripted
    finally:
        await running.stop(0)


async def hang(_request):
    """No answer, ever."""
    await asyncio.Event().wait()
