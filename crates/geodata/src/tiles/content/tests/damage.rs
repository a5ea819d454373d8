//! Damaged files: an error or a content, never a panic, and never more memory than there may be.

use super::*;
use proptest::prelude::*;

/// Files of every kind.
fn files() -> Vec<Vec<u8>> {
    let instanced = tile(
        b"i3dm",
        &bytes![u32; 1],
        [br#"{"INSTANCES_LENGTH":1,"POSITION":[0,0,0],"NORMAL_UP":[0,1,0],"NORMAL_RIGHT":[1,0,0]}"#, &[], br#"{"a":[1]}"#, &[]],
        &triangle_glb(),
    );
    let points = tile(
        b"pnts",
        &[],
        [
            br#"{"POINTS_LENGTH":2,"POSITION":{"byteOffset":0},"RGB":{"byteOffset":24}}"#,
            &[0; 30],
            &[],
            &[],
        ],
        &[],
    );
    let batched = tile(
        b"b3dm",
        &[],
        [br#"{"BATCH_LENGTH":1}"#, &[], br#"{"a":[1]}"#, &[]],
        &triangle_glb(),
    );
    let mut composite = b"cmpt".to_vec();
    composite.extend(bytes![u32; 1, (16 + instanced.len() + points.len()) as u32, 2]);
    composite.extend(&instanced);
    composite.extend(&points);
    vec![
        instanced,
        points,
        batched,
        composite,
        triangle_glb(),
        include_bytes!("../../../../../../tests/data/tiles/draco-edgebreaker.glb").to_vec(),
        include_bytes!("../../../../../../tests/data/tiles/draco-sequential.glb").to_vec(),
        include_bytes!("../../../../../../tests/data/tiles/draco-cloud-kd-tree.pnts").to_vec(),
        include_bytes!("../../../../../../tests/data/tiles/meshopt.glb").to_vec(),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn no_damage_makes_it_panic(
        which in 0..8_usize,
        length in any::<prop::sample::Index>(),
        cut in any::<bool>(),
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
    ) {
        let mut file = files().swap_remove(which);
        for (at, with) in flips {
            let at = at.index(file.len());
            file[at] ^= with;
        }
        if cut {
            file.truncate(length.index(file.len()));
        }
        let _ = alone(&file);
    }

    #[test]
    fn no_pictures_damage_makes_it_panic(
        which in 0..3_usize,
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let files: [&[u8]; 3] = [
            include_bytes!("../../../../../../tests/data/tiles/etc1s.ktx2"),
            include_bytes!("../../../../../../tests/data/tiles/uastc.ktx2"),
            include_bytes!("../../../../../../tests/data/tiles/uastc-zstd.ktx2"),
        ];
        let mut file = files[which].to_vec();
        for (at, with) in flips {
            let at = at.index(file.len());
            file[at] ^= with;
        }
        let _ = crate::tiles::content::picture::decode(&file, "picture");
    }
}

/// What fuzzing found (`fuzz/`), each by its cause: JSON, a zero and binary data, as the target `glb` takes them.
#[test]
fn finds_of_fuzzing_are_errors() {
    // Bounds of a normal's transform the wrong way round: a former Draco decoder panicked.
    let find: &[u8] = include_bytes!("../../../../../../tests/data/tiles/finds/draco-clamp.bin");
    let at = find.iter().position(|byte| *byte == 0).unwrap();
    let root: Value = serde_json::from_slice(&find[..at]).unwrap();
    let refused = alone(&glb(&root, &find[at + 1..])).unwrap_err().to_string();
    assert!(refused.contains("KHR_draco_mesh_compression"), "{refused}");
    // A size of an entropy table in the middle of the stream: it asked for 28 TB, which ended the program.
    let find = include_bytes!("../../../../../../tests/data/tiles/finds/draco-tables.glb");
    let refused = alone(find).unwrap_err().to_string();
    assert!(refused.contains("KHR_draco_mesh_compression"), "{refused}");
}
