//! Mathematics that the engine takes from the platform, by the names that the linker knows: in their place the same on
//! every platform. Windows, Linux and macOS differ in their last bits; so would piles whose glued bodies move together
//! (their inertia is summed by eigenvalues), scenery (normals at its vertices) and the order of the engine's tree.

#![allow(unsafe_code)]

/// Functions of one number, by their names in C.
macro_rules! functions {
    ($($name:ident: $of:path),*) => { $(
        // SAFETY: the function has the meaning and the signature that C gives to this name.
        #[unsafe(no_mangle)]
        extern "C" fn $name(x: f32) -> f32 {
            $of(x)
        }
    )* };
}

functions!(acosf: libm::acosf, cosf: libm::cosf, log2f: libm::log2f);

#[cfg(test)]
mod tests {
    /// What the engine calls. The platform's own differ from `libm` in some of these places.
    #[test]
    fn the_standard_library_calls_these() {
        for x in (1..100_000).map(|i| i as f32 * 1e-5) {
            let y = x * 10.0;
            assert_eq!(y.cos().to_bits(), libm::cosf(y).to_bits(), "the cosine of {y}");
            assert_eq!(x.acos().to_bits(), libm::acosf(x).to_bits(), "the arc cosine of {x}");
            assert_eq!(y.log2().to_bits(), libm::log2f(y).to_bits(), "the logarithm of {y}");
        }
    }
}
