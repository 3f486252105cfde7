# Sourced, in the workspace: installs other engines into $home, and builds those in Rust, C and C++ there.
mkdir -p "$home"

if ! cmp --silent tests/studies/peers/requirements.txt "$home/installed.txt"; then
    "${python:-python3}" -m venv --clear "$home/venv"
    "$home/venv/bin/pip" install --quiet --disable-pip-version-check -r tests/studies/peers/requirements.txt
    cp tests/studies/peers/requirements.txt "$home/installed.txt"
fi

# The engines in C and C++ need CMake and libclang, which the environment has. Without a compiler for them, rapier alone is built.
engines() { # ARGUMENTS
    PATH="$home/venv/bin:$PATH" LIBCLANG_PATH="$("$home/venv/bin/python" -c 'import clang, pathlib; print(pathlib.Path(clang.__path__[0], "native"))')" \
        BINDGEN_EXTRA_CLANG_ARGS="-I$(cc -print-file-name=include)" \
        cargo build --release --locked --quiet --manifest-path tests/studies/peers/engines/Cargo.toml --target-dir "$home/engines" "$@"
}
engines 2>"$home/engines.log" || { tail -n 5 "$home/engines.log" >&2; echo "Box3D and Jolt cannot be built here ($home/engines.log)" >&2; engines --no-default-features; }
