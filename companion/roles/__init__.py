"""The roles of the service, wired: `node` opens what every role reads from (`inputs` says where that is), `uav`
connects the parts that fly, on a vehicle or on a log, and `beacon` measures for it; `uav_service` and `beacon_service`
run a role's tasks and answer its control socket. Opens what a configuration names and connects rooms; decides nothing
itself.
"""
