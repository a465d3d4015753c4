"""`make golden` renews the golden decisions on purpose and prints what moved; `--cut FLIGHT` cuts a golden log anew."""

from __future__ import annotations

from pathlib import Path

import click

from tests.golden.golden_logs import FOLDER, GOLDEN, cut, renew


@click.command()
@click.option("--cut", "flight", type=click.Path(path_type=Path), help="Log of a demo flight to cut a golden log from.")
@click.option("--name", default="approach", show_default=True)
def main(flight: Path | None, name: str) -> None:
    if flight is not None:
        cut(flight, FOLDER / f"{name}.mcap")
        click.echo(f"{name}: cut from {flight}")
        return
    for path in GOLDEN:
        found = renew(path)
        click.echo(f"{path.name}: {'nothing moved' if not found else 'renewed'}")
        for one in found:
            click.echo(f"  {one.topic} {one.difference}")


if __name__ == "__main__":
    main()
