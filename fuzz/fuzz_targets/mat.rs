#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| deacal_fuzz::importer("mat", data));
