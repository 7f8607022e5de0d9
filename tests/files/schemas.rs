//! The schemas in `schemas/` are those of the types. They are written by
//! `DEACAL_WRITE_SCHEMAS=1 cargo test --test files schemas::`.

use std::path::Path;

#[test]
fn committed_schemas_are_current() {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("schemas");
    for (name, text) in deacal::report::schema::schemas() {
        let path = dir.join(format!("{name}.schema.json"));
        if std::env::var_os("DEACAL_WRITE_SCHEMAS").is_some() {
            deacal::report::output::write_atomic(
                &path,
                deacal::report::output::Overwrite::Any,
                &text,
            )
            .unwrap();
        }
        let committed = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            committed == text,
            "{} is not current: run DEACAL_WRITE_SCHEMAS=1 cargo test --test files schemas::",
            path.display()
        );
    }
}
