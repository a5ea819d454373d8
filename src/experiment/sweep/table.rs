//! The table of an experiment, as Parquet and CSV: a row a run.

use super::plan::{Plan, PlannedRun};
use super::run::{Done, STATE_HASH};
use crate::experiment::ExperimentError;
use crate::experiment::figures::Kind;
use crate::output::{self, OutputError};
use parquet::basic::{ConvertedType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;

/// A column with a cell for each row; a cell may be empty.
struct Column {
    name: String,
    cells: Cells,
}

enum Cells {
    Whole(Vec<u64>),
    Numbers(Vec<Option<f64>>),
    Texts(Vec<Option<String>>),
}

/// Writes table.parquet and table.csv of the runs that succeeded, and failed.csv of the others.
pub(super) fn write(
    folder: &Path,
    plan: &Plan,
    rows: &[(PlannedRun, Done)],
) -> Result<(), ExperimentError> {
    let (good, failed): (Vec<_>, Vec<_>) = rows
        .iter()
        .cloned()
        .partition(|(_, done)| done.result.is_ok());
    let columns = columns(plan, &good);
    let path = folder.join("table.parquet");
    let bytes = parquet(&columns).map_err(|error| ExperimentError::Text {
        path: path.clone(),
        message: error.to_string(),
    })?;
    output::write(&path, bytes)?;
    csv(&folder.join("table.csv"), &columns)?;
    let mut lost: Vec<Column> = factor_columns(plan, &failed);
    lost.insert(0, whole("run", &failed, |(run, _)| run.index));
    lost.push(whole("seed", &failed, |(run, _)| run.seed));
    lost.push(texts("error", &failed, |(_, done)| {
        done.result.clone().err()
    }));
    lost.push(texts("command", &failed, |(run, _)| {
        Some(plan.command(run))
    }));
    csv(&folder.join("failed.csv"), &lost)
}

type Row = (PlannedRun, Done);

fn whole(name: &str, rows: &[Row], of: impl Fn(&Row) -> u64) -> Column {
    let cells = rows.iter().map(of).collect();
    Column {
        name: name.into(),
        cells: Cells::Whole(cells),
    }
}

fn texts(name: &str, rows: &[Row], of: impl Fn(&Row) -> Option<String>) -> Column {
    Column {
        name: name.into(),
        cells: Cells::Texts(rows.iter().map(of).collect()),
    }
}

/// A column for each factor: numbers where every value is one.
fn factor_columns(plan: &Plan, rows: &[Row]) -> Vec<Column> {
    let column = |(index, factor): (usize, &super::plan::Factor)| {
        let numbers: Vec<Option<f64>> = rows
            .iter()
            .map(|(run, _)| run.settings[index].number)
            .collect();
        let cells = match numbers.iter().all(Option::is_some) {
            true => Cells::Numbers(numbers),
            false => Cells::Texts(
                rows.iter()
                    .map(|(run, _)| Some(run.settings[index].label.clone()))
                    .collect(),
            ),
        };
        Column {
            name: factor.name.clone(),
            cells,
        }
    };
    plan.factors.iter().enumerate().map(column).collect()
}

fn columns(plan: &Plan, rows: &[Row]) -> Vec<Column> {
    let figure = |done: &Done, key: &str| match &done.result {
        Ok(kept) => kept.get(key).cloned().unwrap_or_default(),
        Err(_) => Value::Null,
    };
    let text = |value: Value| match value {
        Value::Null => None,
        Value::String(text) => Some(text),
        other => Some(other.to_string()),
    };
    let mut columns = vec![whole("run", rows, |(run, _)| run.index)];
    columns.extend(factor_columns(plan, rows));
    columns.push(whole("seed", rows, |(run, _)| run.seed));
    for (key, kind) in &plan.figures {
        columns.push(match kind {
            Kind::Number => Column {
                name: key.clone(),
                cells: Cells::Numbers(
                    rows.iter()
                        .map(|(_, done)| figure(done, key).as_f64())
                        .collect(),
                ),
            },
            Kind::Text => texts(key, rows, |(_, done)| text(figure(done, key))),
        });
    }
    columns.push(texts("scenario_hash", rows, |(_, done)| {
        Some(done.scenario_hash.clone())
    }));
    columns.push(texts("version", rows, |_| Some(crate::VERSION.to_owned())));
    columns.push(texts(STATE_HASH, rows, |(_, done)| {
        text(figure(done, STATE_HASH))
    }));
    columns
}

fn csv(path: &Path, columns: &[Column]) -> Result<(), ExperimentError> {
    let failed = |error: csv::Error| {
        ExperimentError::Output(OutputError::File {
            path: path.into(),
            source: error.into(),
        })
    };
    let mut writer = csv::Writer::from_path(path).map_err(failed)?;
    writer
        .write_record(columns.iter().map(|column| &column.name))
        .map_err(failed)?;
    let rows = columns.first().map_or(0, |column| column.cells.len());
    for row in 0..rows {
        let cells = columns.iter().map(|column| column.cells.text(row));
        writer.write_record(cells).map_err(failed)?;
    }
    writer.flush().map_err(|error| failed(error.into()))
}

impl Cells {
    fn len(&self) -> usize {
        match self {
            Self::Whole(cells) => cells.len(),
            Self::Numbers(cells) => cells.len(),
            Self::Texts(cells) => cells.len(),
        }
    }

    /// A cell as CSV has it; an empty one is empty.
    fn text(&self, row: usize) -> String {
        match self {
            Self::Whole(cells) => cells[row].to_string(),
            Self::Numbers(cells) => cells[row].map(|cell| cell.to_string()).unwrap_or_default(),
            Self::Texts(cells) => cells[row].clone().unwrap_or_default(),
        }
    }
}

/// The table as the bytes of a Parquet file, one row group, uncompressed.
fn parquet(columns: &[Column]) -> Result<Vec<u8>, ParquetError> {
    let field = |column: &Column| {
        let (physical, repetition) = match column.cells {
            Cells::Whole(_) => (Physical::INT64, Repetition::REQUIRED),
            Cells::Numbers(_) => (Physical::DOUBLE, Repetition::OPTIONAL),
            Cells::Texts(_) => (Physical::BYTE_ARRAY, Repetition::OPTIONAL),
        };
        let builder =
            Type::primitive_type_builder(&column.name, physical).with_repetition(repetition);
        let builder = match column.cells {
            Cells::Texts(_) => builder.with_converted_type(ConvertedType::UTF8),
            Cells::Whole(_) => builder.with_converted_type(ConvertedType::UINT_64),
            Cells::Numbers(_) => builder,
        };
        builder.build().map(Arc::new)
    };
    let fields = columns.iter().map(field).collect::<Result<Vec<_>, _>>()?;
    let schema = Type::group_type_builder("sweep")
        .with_fields(fields)
        .build()?;
    // A name with the version would make the bytes depend on the crate.
    let properties = WriterProperties::builder()
        .set_created_by("boresight".to_owned())
        .build();
    let mut bytes = Vec::new();
    let mut file = SerializedFileWriter::new(&mut bytes, Arc::new(schema), Arc::new(properties))?;
    let mut group = file.next_row_group()?;
    for column in columns {
        let Some(mut writer) = group.next_column()? else {
            break;
        };
        match &column.cells {
            Cells::Whole(cells) => {
                // Parquet's unsigned numbers are the same bits.
                let cells: Vec<i64> = cells.iter().map(|cell| cell.cast_signed()).collect();
                writer
                    .typed::<Int64Type>()
                    .write_batch(&cells, None, None)?;
            }
            Cells::Numbers(cells) => {
                let values: Vec<f64> = cells.iter().copied().flatten().collect();
                let levels: Vec<i16> = cells.iter().map(|cell| cell.is_some().into()).collect();
                writer
                    .typed::<DoubleType>()
                    .write_batch(&values, Some(&levels), None)?;
            }
            Cells::Texts(cells) => {
                let values: Vec<ByteArray> = (cells.iter().flatten())
                    .map(|text| text.as_str().into())
                    .collect();
                let levels: Vec<i16> = cells.iter().map(|cell| cell.is_some().into()).collect();
                writer
                    .typed::<ByteArrayType>()
                    .write_batch(&values, Some(&levels), None)?;
            }
        }
        writer.close()?;
    }
    group.close()?;
    file.close()?;
    Ok(bytes)
}
