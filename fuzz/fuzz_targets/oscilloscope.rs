#![no_main]

// the four makes share a file, and each has to answer what another wrote
libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    for name in [
        "tektronix-csv",
        "keysight-csv",
        "rigol-csv",
        "rohde-schwarz-csv",
    ] {
        deacal_fuzz::importer(name, data);
    }
});
