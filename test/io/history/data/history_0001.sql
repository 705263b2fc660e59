-- SPDX-License-Identifier: Apache-2.0
-- Copyright 2026 valve_twin maintainers
-- A history as the first schema wrote it (revision 0001): two cycles of one valve and a service.
BEGIN TRANSACTION;
CREATE TABLE cycle (
	valve_id INTEGER NOT NULL, 
	cycle BIGINT NOT NULL, 
	start_ns BIGINT NOT NULL, 
	end_ns BIGINT NOT NULL, 
	samples BIGINT NOT NULL, 
	lost BIGINT NOT NULL, 
	missed_cycles BIGINT NOT NULL, 
	accepted BOOLEAN NOT NULL, 
	reason TEXT NOT NULL, 
	reproducible BOOLEAN NOT NULL, 
	PRIMARY KEY (valve_id, cycle), 
	FOREIGN KEY(valve_id) REFERENCES valve (id)
);
INSERT INTO "cycle" VALUES(1,41,41000000000,41500000000,500,0,0,1,'',1);
INSERT INTO "cycle" VALUES(1,42,42000000000,42500000000,500,1,0,1,'',1);
CREATE TABLE estimate (
	id INTEGER NOT NULL, 
	valve_id INTEGER NOT NULL, 
	cycle BIGINT NOT NULL, 
	position INTEGER NOT NULL, 
	estimator VARCHAR(64) NOT NULL, 
	model TEXT NOT NULL, 
	start_ns BIGINT NOT NULL, 
	end_ns BIGINT NOT NULL, 
	status INTEGER NOT NULL, 
	reason TEXT NOT NULL, 
	parameters TEXT NOT NULL, 
	mse_test DOUBLE, 
	mse_train DOUBLE, 
	fit_test DOUBLE, 
	fit_train DOUBLE, 
	condition_number DOUBLE, 
	lag BIGINT NOT NULL, 
	noise_sigma DOUBLE, 
	samples_used BIGINT NOT NULL, 
	samples_masked TEXT NOT NULL, 
	missed_cycles BIGINT NOT NULL, 
	used_by_trend BOOLEAN NOT NULL, 
	reproducible BOOLEAN NOT NULL, 
	PRIMARY KEY (id), 
	CONSTRAINT uq_estimate_cycle UNIQUE (valve_id, cycle, estimator), 
	FOREIGN KEY(valve_id) REFERENCES valve (id)
);
INSERT INTO "estimate" VALUES(1,1,41,0,'output_error','press_cartridge',41000000000,41500000000,1,'leak: no rest','{"names":["K_in","leak"],"status":[0,2],"reasons":["","no rest"],"values":[[5.957142857142856,0.001,0.09,0.11],["nan","nan","nan","nan"]]}',NULL,NULL,97.25,NULL,NULL,0,NULL,480,'[1,2,3,4]',0,1,1);
INSERT INTO "estimate" VALUES(2,1,42,0,'output_error','press_cartridge',42000000000,42500000000,1,'leak: no rest','{"names":["K_in","leak"],"status":[0,2],"reasons":["","no rest"],"values":[[6.1,0.001,0.09,0.11],["nan","nan","nan","nan"]]}',NULL,NULL,97.25,NULL,NULL,0,NULL,480,'[1,2,3,4]',0,1,1);
CREATE TABLE maintenance (
	id INTEGER NOT NULL, 
	valve_id INTEGER NOT NULL, 
	stamp_ns BIGINT NOT NULL, 
	cycle BIGINT NOT NULL, 
	note TEXT NOT NULL, 
	new_reference BOOLEAN NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(valve_id) REFERENCES valve (id)
);
INSERT INTO "maintenance" VALUES(1,1,41500000000,42,'new seal',1);
CREATE TABLE meta (
	name VARCHAR(64) NOT NULL, 
	value TEXT NOT NULL, 
	PRIMARY KEY (name)
);
INSERT INTO "meta" VALUES('content','valve_twin history');
CREATE TABLE valve (
	id INTEGER NOT NULL, 
	name VARCHAR(255) NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (name)
);
INSERT INTO "valve" VALUES(1,'/press/valve_1');
CREATE TABLE valve_twin_schema (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT valve_twin_schema_pkc PRIMARY KEY (version_num)
);
INSERT INTO "valve_twin_schema" VALUES('0001');
CREATE INDEX ix_maintenance_valve_id ON maintenance (valve_id);
COMMIT;
