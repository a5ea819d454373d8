# shellcheck shell=bash disable=SC2034
# The environment that every script here shares; `source scripts/env.sh` gives it to a shell of your own.

boresight_cache=${XDG_CACHE_HOME:-$HOME/.cache}/boresight
boresight_venv=$boresight_cache/venv
boresight_ort_version=1.31.1
boresight_ort_lib=$boresight_cache/onnxruntime/$boresight_ort_version/libonnxruntime.so

# rustup's own place, for shells that were not started as a login shell.
if ! command -v cargo >/dev/null 2>&1 && [[ -x $HOME/.cargo/bin/cargo ]]; then
  export PATH=$HOME/.cargo/bin:$PATH
fi

# Outside the checkout, so that every checkout shares one build of the dependencies.
export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$boresight_cache/target}
export ORT_DYLIB_PATH=${ORT_DYLIB_PATH:-$boresight_ort_lib}
# Mesa complains on standard error where a session has none, as in a container.
export XDG_RUNTIME_DIR=${XDG_RUNTIME_DIR:-${TMPDIR:-/tmp}}
