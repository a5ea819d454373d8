//! The records of an IFC file, with its units: points, directions, placements.

use boresight_common::warning::Notes;
use glam::{DAffine3, DMat3, DVec3};
use ifc_lite_core::{AttributeValue, DecodedEntity, EntityDecoder, IfcType};

/// Deepest nesting of placements, mapped items, Boolean operands, profiles and curves.
pub const DEEPEST: usize = 32;
/// Most faces of a file.
const MOST_FACES: usize = 8_000_000;
/// Most representation items of a file, each time counted that a map shows it.
const MOST_ITEMS: usize = 1_000_000;

/// Rings of a face: outline and holes [m].
pub type Face = Vec<Vec<DVec3>>;

/// A record that is left out: its kind in the plural with the reason, and where it stands.
#[derive(Debug)]
pub struct Lost {
    /// Kind and reason.
    pub kind: String,
    /// The record.
    pub place: String,
}

impl Lost {
    /// A record of a kind that is not read.
    pub fn kind(entity: &DecodedEntity, what: &str) -> Self {
        Self {
            kind: format!("{} {what}", entity.ifc_type.name()),
            place: format!("#{}", entity.id),
        }
    }

    /// A record that lacks something, or refers to what is not there.
    pub fn damaged(entity: &DecodedEntity) -> Self {
        Self {
            kind: format!("damaged {} records", entity.ifc_type.name()),
            place: format!("#{}", entity.id),
        }
    }
}

/// A file's records.
pub struct Model<'a> {
    decoder: EntityDecoder<'a>,
    /// Metres in the file's unit of length.
    pub unit_m: f64,
    /// Radians in the file's unit of plane angles.
    pub angle_rad: f64,
    /// Whether the file states its unit of plane angles.
    pub angle_stated: bool,
    /// What was assumed and left out.
    pub notes: Notes,
    /// The product that is being read, in words.
    pub product: String,
    /// Faces that may still be made.
    pub left: usize,
    /// Representation items, curves and profiles that may still be looked at.
    pub items_left: usize,
}

impl<'a> Model<'a> {
    /// A model in metres and radians until its units are read.
    pub fn new(decoder: EntityDecoder<'a>) -> Self {
        Self {
            decoder,
            unit_m: 1.0,
            angle_rad: 1.0,
            angle_stated: false,
            notes: Notes::default(),
            product: String::new(),
            left: MOST_FACES,
            items_left: MOST_ITEMS,
        }
    }

    /// A record; none where it is missing or damaged.
    pub fn entity(&mut self, id: u32) -> Option<DecodedEntity> {
        self.decoder.decode_by_id(id).ok()
    }

    /// A record's bytes as they stand in the file.
    pub fn bytes(&mut self, id: u32) -> Option<&'a [u8]> {
        self.decoder.get_raw_bytes(id)
    }

    /// Whether the file made more faces than are held.
    pub fn exhausted(&self) -> bool {
        self.left == 0 || self.items_left == 0
    }

    /// Counts an item, a curve or a profile that is looked at; none where the file has had enough of them: a few records that name each
    /// other can ask for any number.
    pub fn spend(&mut self) -> Option<()> {
        self.items_left = self.items_left.checked_sub(1)?;
        Some(())
    }

    /// Counts a record that is left out of the product that is being read.
    pub fn leave_out(&mut self, lost: Lost) {
        let place = match self.product.as_str() {
            "" => lost.place,
            product => format!("{} in {product}", lost.place),
        };
        self.notes.leave_out(lost.kind, place);
    }

    /// The record that an attribute refers to.
    pub fn at(&mut self, entity: &DecodedEntity, slot: usize) -> Option<DecodedEntity> {
        let id = entity.get_ref(slot)?;
        self.entity(id)
    }

    /// The record that an attribute must refer to.
    pub fn need(&mut self, entity: &DecodedEntity, slot: usize) -> Result<DecodedEntity, Lost> {
        self.at(entity, slot).ok_or_else(|| Lost::damaged(entity))
    }

    /// The records that an attribute lists, without those that are missing.
    pub fn all(&mut self, entity: &DecodedEntity, slot: usize) -> Vec<DecodedEntity> {
        let ids = entity.get_refs(slot).unwrap_or_default();
        ids.into_iter().filter_map(|id| self.entity(id)).collect()
    }

    /// A point or direction of two or three numbers, as they stand.
    pub fn vector(&mut self, entity: &DecodedEntity, slot: usize) -> Option<DVec3> {
        let found = self.at(entity, slot)?;
        numbers(found.get_list(0)?)
    }

    /// A direction that may be absent; the record that states it is damaged where it is no direction.
    fn direction(
        &mut self,
        entity: &DecodedEntity,
        slot: usize,
        otherwise: DVec3,
    ) -> Result<DVec3, Lost> {
        if entity.get(slot).is_none_or(AttributeValue::is_null) {
            return Ok(otherwise);
        }
        self.vector(entity, slot)
            .ok_or_else(|| Lost::damaged(entity))
    }

    /// Positive lengths [m].
    pub fn lengths<const N: usize>(
        &self,
        entity: &DecodedEntity,
        slots: [usize; N],
    ) -> Result<[f64; N], Lost> {
        let all = slots.map(|slot| entity.get_float(slot).unwrap_or(f64::NAN) * self.unit_m);
        let sound = all.iter().all(|v| v.is_finite() && *v > 0.0);
        sound.then_some(all).ok_or_else(|| Lost::damaged(entity))
    }

    /// `IfcAxis2Placement3D` or `2D`, in metres; without one the identity.
    pub fn axes_at(&mut self, entity: &DecodedEntity, slot: usize) -> Result<DAffine3, Lost> {
        if entity.get(slot).is_none_or(AttributeValue::is_null) {
            return Ok(DAffine3::IDENTITY);
        }
        let placement = self.need(entity, slot)?;
        self.axis_placement(&placement)
    }

    /// `IfcAxis2Placement3D` or `2D`, in metres.
    pub fn axis_placement(&mut self, placement: &DecodedEntity) -> Result<DAffine3, Lost> {
        let flat = match placement.ifc_type {
            IfcType::IfcAxis2Placement2D => true,
            IfcType::IfcAxis2Placement3D => false,
            _ => return Err(Lost::kind(placement, "placements")),
        };
        let origin = self.vector(placement, 0);
        let origin = origin.ok_or_else(|| Lost::damaged(placement))? * self.unit_m;
        if flat {
            let x = self.direction(placement, 1, DVec3::X)?;
            return Ok(axes(origin, DVec3::Z, x));
        }
        let z = self.direction(placement, 1, DVec3::Z)?;
        let x = self.direction(placement, 2, DVec3::X)?;
        Ok(axes(origin, z, x))
    }

    /// A product's placement in the model [m], through all that it stands on.
    pub fn placement(&mut self, product: &DecodedEntity) -> Result<DAffine3, Lost> {
        let mut found = DAffine3::IDENTITY;
        if product.get(5).is_none_or(AttributeValue::is_null) {
            return Ok(found);
        }
        let mut placement = self.need(product, 5)?;
        for _ in 0..DEEPEST {
            match placement.ifc_type {
                IfcType::IfcLocalPlacement => {
                    found = self.axes_at(&placement, 1)? * found;
                }
                // Along an alignment: its place in Cartesian axes stands beside it.
                IfcType::IfcLinearPlacement => {
                    let own = self.at(&placement, 2);
                    let own = own.ok_or_else(|| Lost::kind(&placement, "placements"))?;
                    found = self.axis_placement(&own)? * found;
                }
                _ => return Err(Lost::kind(&placement, "placements")),
            }
            if placement.get(0).is_none_or(AttributeValue::is_null) {
                return Ok(found);
            }
            placement = self.need(&placement, 0)?;
        }
        Err(Lost {
            kind: "placements that run in a circle".into(),
            place: format!("#{}", placement.id),
        })
    }

    /// `IfcCartesianTransformationOperator2D` or `3D`, with one scale or one for each axis.
    pub fn operator(&mut self, operator: &DecodedEntity) -> Result<DAffine3, Lost> {
        let damaged = || Lost::damaged(operator);
        let origin = self.vector(operator, 2).ok_or_else(damaged)? * self.unit_m;
        let x = self.direction(operator, 0, DVec3::X)?;
        let flat = matches!(
            operator.ifc_type,
            IfcType::IfcCartesianTransformationOperator2D
                | IfcType::IfcCartesianTransformationOperator2DnonUniform
        );
        let z = if flat { None } else { self.vector(operator, 4) };
        let y = self.vector(operator, 1);
        let z = match (z, y) {
            (Some(z), _) => z,
            (None, Some(y)) if !flat => x.cross(y),
            _ => DVec3::Z,
        };
        let mut found = axes(origin, z, x);
        // A second axis against the right hand's mirrors.
        if y.is_some_and(|y| y.dot(found.matrix3.y_axis) < 0.0) {
            found.matrix3.y_axis = -found.matrix3.y_axis;
        }
        let scale = operator.get_float(3).unwrap_or(1.0);
        let own = |slot| operator.get_float(slot).unwrap_or(scale);
        let scales = match operator.ifc_type {
            IfcType::IfcCartesianTransformationOperator3DnonUniform => {
                DVec3::new(scale, own(5), own(6))
            }
            IfcType::IfcCartesianTransformationOperator2DnonUniform => {
                DVec3::new(scale, own(4), 1.0)
            }
            IfcType::IfcCartesianTransformationOperator2D => DVec3::new(scale, scale, 1.0),
            _ => DVec3::splat(scale),
        };
        let sound = scales.is_finite() && scales.abs().min_element() > 1e-9;
        found.matrix3 *= DMat3::from_diagonal(scales);
        sound.then_some(found).ok_or_else(damaged)
    }
}

/// Up to three numbers of a list; those that are not there are zero.
pub fn numbers(list: &[AttributeValue]) -> Option<DVec3> {
    let number = |k: usize| list.get(k).map_or(Some(0.0), AttributeValue::as_float);
    let found = Some(DVec3::new(number(0)?, number(1)?, number(2)?));
    found.filter(|v| v.is_finite() && !list.is_empty())
}

/// A placement about a place with two axes, as `IfcAxis2Placement3D` has them.
fn axes(origin: DVec3, z: DVec3, x: DVec3) -> DAffine3 {
    let z = z.try_normalize().unwrap_or(DVec3::Z);
    let x = (x - z * x.dot(z))
        .try_normalize()
        .unwrap_or_else(|| z.any_orthonormal_vector());
    DAffine3::from_mat3_translation(DMat3::from_cols(x, z.cross(x), z), origin)
}
