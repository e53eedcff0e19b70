"""What each of Fabric's servers is told: the content of its settings file, as plain data. Pure.

Native processes and containers are told the same; only the places differ. Values that are not Fabric's defaults have
their reason beside them; sources: Fabric's ``sampleconfig`` and what was measured for this project.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any, Final

from wonderland_fabric_gateway.ca.requests import TLS_PROFILE

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import PurePath

    from wonderland_fabric_network.description import Certificates
    from wonderland_fabric_network.layout import NodeDirectory

NODE_OUS: Final = {
    "NodeOUs": {
        "Enable": True,
        **{
            f"{kind}OUIdentifier": {"OrganizationalUnitIdentifier": kind.lower()}
            for kind in ("Client", "Peer", "Admin", "Orderer")
        },
    }
}
"""config.yaml of an MSP directory."""

IMAGE_BUILDER: Final = PurePosixPath("/opt/hyperledger/ccaas_builder")
"""Where Fabric's image of a peer has its builder of contract servers."""
BUILDER_VARIABLE: Final = "CHAINCODE_AS_A_SERVICE_BUILDER_CONFIG"
MAX_MESSAGE_BYTES: Final = 100 << 20
TLS_CA_DIRECTORY: Final = "tls-ca"
LOGGING: Final = "comm.grpc.server,endorser,gateway,gossip.privdata,committer.txvalidator=warn:info"
"""What servers log. At info these modules write nine of ten lines, one or more for each call, which costs a peer about
4 % of its processor; blocks, connections, elections and everything that goes wrong is still said."""
_BCCSP: Final = {"Default": "SW", "SW": {"Hash": "SHA2", "Security": 256}}


@dataclass(frozen=True)
class CaPlace:
    """Where a Fabric CA listens, who may register identities with it, and the names that its TLS certificate is for."""

    bind: str
    port: int
    operations_port: int
    registrar: str
    secret: str
    hosts: tuple[str, ...]


def ca_name(msp_id: str) -> str:
    """The name of the CA that certifies an organisation's identities."""
    return f"ca-{msp_id.lower()}"


def tls_ca_name(msp_id: str) -> str:
    """The name of the CA that certifies an organisation's TLS certificates; in the same server."""
    return f"tls-{msp_id.lower()}"


def ca_server(msp_id: str, place: CaPlace, certificates: Certificates, tls_ca_file: PurePath) -> dict[str, Any]:
    """fabric-ca-server-config.yaml of an organisation's server; the second CA's settings are in `tls_ca_file`."""
    return {
        **ca_instance(msp_id, ca_name(msp_id), place, certificates),
        "port": place.port,
        "address": place.bind,
        "cafiles": [str(tls_ca_file)],
        "tls": {"enabled": True},
        # Unique per server: the default is one port for all.
        "operations": {"listenAddress": f"{place.bind}:{place.operations_port}"},
        "metrics": {"provider": "prometheus"},
        "cfg": {"identities": {"allowremove": False}},
    }


def ca_instance(msp_id: str, name: str, place: CaPlace, certificates: Certificates) -> dict[str, Any]:
    """The settings of one CA in a server."""
    valid = f"{24 * certificates.valid_days}h"
    registrar = {
        "name": place.registrar,
        "pass": place.secret,
        "type": "client",
        "affiliation": "",
        "attrs": {
            "hf.Registrar.Roles": "*",
            "hf.Registrar.DelegateRoles": "*",
            "hf.Registrar.Attributes": "*",
            "hf.Revoker": True,
            "hf.GenCRL": True,
        },
    }
    return {
        "version": "1.5",
        "ca": {"name": name},
        "crl": {"expiry": f"{24 * certificates.revocation_list_days}h"},
        "registry": {"maxenrollments": -1, "identities": [registrar]},
        "db": {"type": "sqlite3", "datasource": "ca.db"},
        "affiliations": {},
        "signing": {
            "default": {"usage": ["digital signature"], "expiry": valid},
            "profiles": {
                TLS_PROFILE: {
                    "usage": ["digital signature", "key agreement", "server auth", "client auth"],
                    "expiry": valid,
                }
            },
        },
        "csr": {
            "cn": f"{name}.{msp_id}",
            "keyrequest": {"algo": "ecdsa", "size": 256},
            "names": [{"O": msp_id}],
            "hosts": list(place.hosts),
            "ca": {"expiry": f"{24 * 365 * 15}h", "pathlength": 0},
        },
        # Not used here; the smallest that the server accepts, since it makes these keys at each first start.
        "idemix": {"rhpoolsize": 1, "curve": "amcl.Fp256bn"},
        "bccsp": {
            "default": "SW",
            "sw": {"hash": "SHA2", "security": 256, "filekeystore": {"keystore": "msp/keystore"}},
        },
    }


def orderer(
    msp_id: str, node: NodeDirectory, bind: str, port: int, admin_port: int, operations_port: int
) -> dict[str, Any]:
    """orderer.yaml. `bind` is the address on which it listens."""
    tls = {
        "Enabled": True,
        "PrivateKey": str(node.tls.key),
        "Certificate": str(node.tls.certificate),
        "RootCAs": [str(node.tls_root)],
    }
    return {
        "General": {
            "ListenAddress": bind,
            "ListenPort": port,
            # Mutual TLS. Peers' and other orderers' TLS roots an orderer learns from the channel.
            "TLS": {**tls, "ClientAuthRequired": True, "ClientRootCAs": [str(node.tls_root)]},
            "Keepalive": {"ServerMinInterval": "60s", "ServerInterval": "7200s", "ServerTimeout": "20s"},
            "MaxRecvMsgSize": MAX_MESSAGE_BYTES,
            "MaxSendMsgSize": MAX_MESSAGE_BYTES,
            "Cluster": {
                "ClientCertificate": str(node.tls.certificate),
                "ClientPrivateKey": str(node.tls.key),
                "RootCAs": [str(node.tls_root)],
                "SendBufferSize": 100,
                # With the defaults of 7 s and 5 s a dead leader stalls the channel for twice as long.
                "RPCTimeout": "1s",
                "DialTimeout": "1s",
                # BFT's default, "consensus", asks other orderers for blocks without the hash of its TLS certificate;
                # where TLS is mutual they refuse that, and an orderer that fell behind never catches up (Fabric 3.1.5;
                # decision 0013).
                "ReplicationPolicy": "simple",
            },
            "LocalMSPDir": str(node.msp),
            "LocalMSPID": msp_id,
            "BCCSP": _BCCSP,
            "Authentication": {"TimeWindow": "15m"},
        },
        "FileLedger": {"Location": str(node.data)},
        "Operations": {"ListenAddress": f"{bind}:{operations_port}", "TLS": {"Enabled": False}},
        "Metrics": {"Provider": "prometheus"},
        "Admin": {
            "ListenAddress": f"{bind}:{admin_port}",
            "TLS": {**tls, "ClientAuthRequired": True, "ClientRootCAs": [str(node.tls_root)]},
        },
        "ChannelParticipation": {"Enabled": True, "MaxRequestBodySize": "10 MB"},
        "Consensus": {"WALDir": str(node.data / "consensus" / "wal"), "SnapDir": str(node.data / "consensus" / "snap")},
    }


@dataclass(frozen=True)
class PeerPlace:
    """Where a peer listens and is found, and which peers of its organisation it greets first."""

    name: str
    host: str
    bind: str
    port: int
    chaincode_port: int
    operations_port: int
    bootstrap: tuple[str, ...]

    @property
    def address(self) -> str:
        """``host:port`` for clients and other peers."""
        return f"{self.host}:{self.port}"


def peer(msp_id: str, node: NodeDirectory, place: PeerPlace, builder: PurePath) -> dict[str, Any]:
    """core.yaml."""
    return {
        "peer": {
            "id": f"{place.name}.{msp_id}",
            "networkId": "wonderland",
            "listenAddress": f"{place.bind}:{place.port}",
            "address": place.address,
            # Both are one port for all peers by default.
            "chaincodeListenAddress": f"{place.bind}:{place.chaincode_port}",
            "chaincodeAddress": f"{place.host}:{place.chaincode_port}",
            "localMspId": msp_id,
            "mspConfigPath": str(node.msp),
            "fileSystemPath": str(node.data),
            "gateway": {"enabled": True, "endorsementTimeout": "30s", "broadcastTimeout": "30s", "dialTimeout": "2m"},
            "keepalive": {
                "interval": "7200s",
                "timeout": "20s",
                "minInterval": "60s",
                "client": {"interval": "60s", "timeout": "20s"},
                "deliveryClient": {"interval": "60s", "timeout": "20s"},
            },
            "gossip": _gossip(place),
            "tls": {
                "enabled": True,
                # Mutual TLS. Other organisations' peers have other TLS roots, which a peer learns from the channel.
                "clientAuthRequired": True,
                "clientRootCAs": {"files": [str(node.tls_root)]},
                "cert": {"file": str(node.tls.certificate)},
                "key": {"file": str(node.tls.key)},
                "rootcert": {"file": str(node.tls_root)},
            },
            "authentication": {"timewindow": "15m"},
            "BCCSP": _BCCSP,
            "client": {"connTimeout": "3s"},
            "deliveryclient": {
                "blockGossipEnabled": False,
                "reconnectTotalTimeThreshold": "3600s",
                "connTimeout": "3s",
                # The default lets a peer wait up to an hour before it asks an orderer again that was away.
                "reConnectBackoffThreshold": "2s",
                "blockCensorshipTimeoutKey": "30s",
                "minimalReconnectInterval": "100ms",
                "policy": "cluster",
            },
            "handlers": {
                "authFilters": [{"name": "DefaultAuth"}, {"name": "ExpirationCheck"}, {"name": "TimeWindowCheck"}],
                "decorators": [{"name": "DefaultDecorator"}],
                "endorsers": {"escc": {"name": "DefaultEndorsement"}},
                "validators": {"vscc": {"name": "DefaultValidation"}},
            },
            "discovery": {
                "enabled": True,
                "authCacheEnabled": True,
                "authCacheMaxSize": 1000,
                "authCachePurgeRetentionRatio": 0.75,
                "orgMembersAllowedAccess": False,
            },
            "limits": {"concurrency": {"endorserService": 2500, "deliverService": 2500, "gatewayService": 500}},
            "maxRecvMsgSize": MAX_MESSAGE_BYTES,
            "maxSendMsgSize": MAX_MESSAGE_BYTES,
        },
        "vm": {"endpoint": ""},  # no containers: contracts run as services
        "chaincode": {
            "externalBuilders": [
                {"name": "ccaas_builder", "path": str(builder), "propagateEnvironment": [BUILDER_VARIABLE, "PATH"]}
            ],
            "installTimeout": "300s",
            "startuptimeout": "60s",
            "executetimeout": "30s",
            "mode": "net",
            "keepalive": 0,
            "system": {"_lifecycle": "enable", "cscc": "enable", "lscc": "enable", "qscc": "enable"},
            "logging": {"level": "info", "shim": "warning"},
            "runtimeParams": {
                "useWriteBatch": True,
                "maxSizeWriteBatch": 1000,
                "useGetMultipleKeys": True,
                "maxSizeGetMultipleKeys": 1000,
            },
        },
        "ledger": {
            "state": {"stateDatabase": "goleveldb", "totalQueryLimit": 100_000},
            "history": {"enableHistoryDatabase": True},
            "pvtdataStore": {
                "collElgProcMaxDbBatchSize": 5000,
                "collElgProcDbBatchesInterval": 1000,
                "deprioritizedDataReconcilerInterval": "60m",
                "purgeInterval": 100,
                "purgedKeyAuditLogging": True,
            },
            "snapshots": {"rootDir": str(node.data / "snapshots")},
        },
        "operations": {"listenAddress": f"{place.bind}:{place.operations_port}", "tls": {"enabled": False}},
        "metrics": {"provider": "prometheus"},
    }


def builder_configuration(addresses: Sequence[str], client_certificate: bytes, client_key: bytes, root: bytes) -> str:
    """What a peer's environment tells the builder of contract servers, JSON.

    Two addresses, so that a new version of the contract can run beside the one that it replaces.
    """
    names = ("address_a", "address_b")
    return json.dumps(
        {
            **dict(zip(names, addresses, strict=True)),
            "client_cert": client_certificate.decode(),
            "client_key": client_key.decode(),
            "root_cert": root.decode(),
        }
    )


def _gossip(place: PeerPlace) -> dict[str, Any]:
    return {
        "bootstrap": " ".join(place.bootstrap),
        "endpoint": place.address,
        # Without it other organisations do not learn of this peer, and no endorsement plan spans organisations.
        "externalEndpoint": place.address,
        "useLeaderElection": False,
        "orgLeader": True,
        # With the default timers a network that was just started finds no endorsers for half a minute.
        "reconnectInterval": "2s",
        "publishStateInfoInterval": "1s",
        "requestStateInfoInterval": "1s",
        "aliveTimeInterval": "1s",
        "aliveExpirationTimeout": "5s",
        "membershipTrackerInterval": "5s",
        "maxBlockCountToStore": 10,
        "maxPropagationBurstLatency": "10ms",
        "maxPropagationBurstSize": 10,
        "propagateIterations": 1,
        "propagatePeerNum": 3,
        "pullInterval": "4s",
        "pullPeerNum": 3,
        "publishCertPeriod": "10s",
        "dialTimeout": "3s",
        "connTimeout": "2s",
        "recvBuffSize": 20,
        "sendBuffSize": 200,
        "digestWaitTime": "1s",
        "requestWaitTime": "1500ms",
        "responseWaitTime": "2s",
        "maxConnectionAttempts": 120,
        "msgExpirationFactor": 20,
        "state": {"enabled": False},
        # All of it: a pushAckTimeout that is not set is 0, and fails.
        "pvtData": {
            # How long a block waits for private data that nobody has any more: a peer that joins anew after the loss of
            # its ledger waits so long at each approval of its organisation. What comes later is reconciled.
            "pullRetryThreshold": "2s",
            "transientstoreMaxBlockRetention": 20_000,
            "pushAckTimeout": "3s",
            "btlPullMargin": 10,
            "reconcileBatchSize": 10,
            "reconcileSleepInterval": "1m",
            "reconciliationEnabled": True,
            "skipPullingInvalidTransactionsDuringCommit": False,
            "implicitCollectionDisseminationPolicy": {"requiredPeerCount": 0, "maxPeerCount": 1},
        },
    }
