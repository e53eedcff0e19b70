"""A real Hyperledger Fabric network from one description, by Python alone.

- `description`: network.yaml, its JSON Schema, its errors. `endorsement`: policies such as AND('A.peer', 'B.peer').
- `layout`: where everything lies in the network's directory. `ports`: who listens where.
- `binaries`, `processes`, `settings`: Fabric's servers, found, configured, started and stopped.
- `authorities`: an organisation's Fabric CA and all that it certifies.
- `genesis`, `config_update`: the channel's first block, and changes to its configuration.
- `orderers`, `peers`, `lifecycle`, `contract`: joining, and agreeing on a contract.
- `bringing_up`, `administration`, `status`: what the commands do. `commands`: ``wonderland network``.

Only `peer`, `orderer` and `fabric-ca-server` are needed; no configtxgen, cryptogen, osnadmin or peer CLI.
"""
