"""Turns what `cargo build --message-format=json` says into rustc's arguments for the program's libraries."""

import json
import os
import subprocess
import sys

LIBRARIES = (".rlib", ".so", ".dylib")
files, native = {}, []
for line in sys.stdin:
    message = json.loads(line)
    if message.get("reason") == "compiler-artifact":
        for name in message["filenames"]:
            if name.endswith(LIBRARIES):
                files[message["package_id"]] = name
    elif message.get("reason") == "build-script-executed":
        native += message["linked_paths"]
facts = subprocess.check_output(["rustc", "-vV"], text=True)
host = next(line.split()[1] for line in facts.splitlines() if line.startswith("host:"))
command = ["cargo", "metadata", "--format-version=1", f"--filter-platform={host}"]
metadata = json.loads(subprocess.check_output(command))
root = metadata["resolve"]["root"]
node = next(node for node in metadata["resolve"]["nodes"] if node["id"] == root)
folders = {os.path.dirname(name) for package, name in files.items() if package != root}
for folder in sorted(folders):
    print(f"-Ldependency={folder}")
for path in sorted(set(native)):
    print(f"-L{path}")
for dependency in node["deps"]:
    if dependency["pkg"] in files:
        print("--extern")
        print(f"{dependency['name']}={files[dependency['pkg']]}")
