"""Files for clusters in the documentation: their parts fit together, and their commands are kinid's."""

from __future__ import annotations

import ast
from pathlib import Path

import typer
import yaml

from kinid.cli import app

CLUSTER = Path(__file__).parents[2] / "docs" / "cluster"


def test_the_parts_on_kubernetes_fit_together() -> None:
    parts = {
        (part["kind"], part["metadata"]["name"]): part
        for part in yaml.safe_load_all((CLUSTER / "kubernetes.yaml").read_text(encoding="utf-8"))
    }
    pods = {name: part["spec"]["template"] for (_, name), part in parts.items() if "template" in part["spec"]}
    service = parts["Service", "kinid-scheduler"]["spec"]
    assert pods["kinid-scheduler"]["metadata"]["labels"] == service["selector"]
    for (kind, name), part in parts.items():
        if kind == "Deployment":
            assert part["spec"]["selector"]["matchLabels"] == pods[name]["metadata"]["labels"]
    policy = parts["NetworkPolicy", "kinid"]["spec"]["podSelector"]["matchLabels"]
    assert all(policy.items() <= pod["metadata"]["labels"].items() for pod in pods.values())
    address = f"tcp://{parts['Service', 'kinid-scheduler']['metadata']['name']}:{service['ports'][0]['port']}"
    words = {name: pod["spec"]["containers"][0]["command"] for name, pod in pods.items()}
    assert address in words["kinid-workers"]
    assert address in words["kinid-contact"]
    first, command, *rest = words["kinid-contact"]
    known = typer.main.get_command(app).commands[command].params  # type: ignore[attr-defined]
    assert first == "kinid"
    assert {word for word in rest if word.startswith("-")} <= {option for p in known for option in p.opts}


def test_the_script_for_batch_systems_can_be_read() -> None:
    ast.parse((CLUSTER / "batch_system.py").read_text(encoding="utf-8"))
