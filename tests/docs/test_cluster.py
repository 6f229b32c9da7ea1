"""The job files of docs/cluster: their syntax, and that they start what `unproject` has."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import yaml

from unproject.cli import VERBS

CLUSTER = Path(__file__).parents[2] / "docs" / "cluster"
SLURM, KUBERNETES = CLUSTER / "slurm.sh", CLUSTER / "kubernetes.yaml"


def check(script: str) -> None:
    """The shell can read it, and its commands are verbs with the same flags in the same order.

    What makes a run of a folder is its recipe.json, which comes last: what a kill left before it cannot be resumed.
    """
    done = subprocess.run(["bash", "-n"], input=script, text=True, capture_output=True)
    assert done.returncode == 0 and not done.stderr
    assert re.findall(r"if \[ (.+) \]; then", script) == ['-f "$RUN/recipe.json"']
    verbs = re.findall(r"COMMAND=\((\w+) ", script)
    assert verbs == ["resume", "train"] and set(verbs) <= set(VERBS)
    assert '-m unproject "${COMMAND[@]}"' in script and len(re.findall("--steps 20000", script)) == 2


def test_the_slurm_job_is_a_shell_script() -> None:
    script = SLURM.read_text()
    check(script)
    flags = re.findall(r"^#SBATCH (--[\w-]+)(?:=\S+)?$", script, re.MULTILINE)
    assert len(flags) == script.count("#SBATCH") and {"--nodes", "--signal", "--time"} <= set(flags)


def test_the_kubernetes_job_is_yaml_of_a_service_and_a_job() -> None:
    service, job = yaml.safe_load_all(KUBERNETES.read_text())
    assert (service["kind"], job["kind"], job["apiVersion"]) == ("Service", "Job", "batch/v1")
    spec, pod = job["spec"], job["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    check(container["args"][0])
    assert spec["completions"] == spec["parallelism"] == 2 and "--nnodes 2" in container["args"][0]
    name = job["metadata"]["name"]
    assert service["spec"]["selector"] == {"job-name": name} and pod["subdomain"] == service["metadata"]["name"]
    assert f"{name}-0.{pod['subdomain']}" in container["args"][0]
    assert container["resources"]["limits"]["nvidia.com/gpu"] == 4 and "--nproc-per-node 4" in container["args"][0]
    assert {mount["name"] for mount in container["volumeMounts"]} == {volume["name"] for volume in pod["volumes"]}
